//! Compiles the contract, without `protoc`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let contract = "../../../proto";
    let files = ["query", "rig"].map(|name| format!("duralab/v1/{name}.proto"));
    println!("cargo:rerun-if-changed={contract}/duralab");
    prost_build::Config::new()
        .enable_type_names()
        .compile_fds(protox::compile(files, [contract])?)?;
    Ok(())
}
