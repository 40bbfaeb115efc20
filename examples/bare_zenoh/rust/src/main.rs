//! Plays a drive on a rig and shows how far it is, with nothing but Zenoh and the messages of the contract.
//!
//! `cargo run -- [ENDPOINT [RIG]]`; how queries travel is said in docs/contract.md.

use std::{env, error::Error, f64::consts::TAU, process, thread, time::Duration};

use prost::{Message, Name};
use zenoh::{Session, Wait, query::ConsolidationMode, sample::Sample};

mod duralab {
    // The contract has more messages than this program needs.
    #![allow(dead_code)]
    include!(concat!(env!("OUT_DIR"), "/duralab.v1.rs"));
}
use duralab::{
    Array, Channel, DescriptionRequest, ElementType, Fault, PlayRequest, PlayResult, Progress, Record, RigDescription,
};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

const ROOT: &str = "duralab/v1/local";

fn main() -> Outcome<()> {
    let mut given = env::args().skip(1);
    let endpoint = given.next().unwrap_or("tcp/127.0.0.1:7474".into());
    let rig = given.next().unwrap_or("front_axle_compliant".into());
    let session = join(&endpoint)?;
    wait_for(&session, &rig)?;

    let key = format!("{ROOT}/rig/{rig}/description");
    let description: RigDescription = ask(&session, &key, &DescriptionRequest {})?;
    println!("{rig}: {}", description.specimen);

    let request = PlayRequest {
        run: format!("rust-{}", process::id()),
        drive: Some(gentle_drive(&description)),
        seed: 1,
        ..Default::default()
    };
    let played: PlayResult = ask(&session, &format!("{ROOT}/rig/{rig}/play"), &request)?;
    let response = played.response.ok_or("The rig answered without a response.")?;
    let samples = doubles(response.samples.as_ref().ok_or("The response has no samples.")?)?;
    let length = samples.len() / response.channels.len();
    for (channel, row) in response.channels.iter().zip(samples.chunks(length)) {
        let (low, high) = row
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        println!("{}: {low:.1} to {high:.1} {}", channel.name, channel.unit);
    }
    Ok(())
}

/// Open a session that listens itself: a peer without a listener receives nothing.
fn join(endpoint: &str) -> Outcome<Session> {
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", r#""peer""#)?;
    config.insert_json5("connect/endpoints", &format!("[{endpoint:?}]"))?;
    config.insert_json5("listen/endpoints", r#"["tcp/127.0.0.1:0"]"#)?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    zenoh::open(config).wait()
}

/// A new session takes about a second to meet everyone: wait for the token of who is to be asked.
fn wait_for(session: &Session, rig: &str) -> Outcome<()> {
    let token = format!("{ROOT}/live/rig_sim/{rig}");
    for _ in 0..100 {
        if session.liveliness().get(&token).wait()?.recv().is_ok() {
            return Ok(());
        }
        thread::sleep(Duration::from_millis(100));
    }
    Err(format!("No rig {rig:?} is on the bus after 10 s.").into())
}

/// Ask, print the progress, and return the one answer.
fn ask<Request: Message + Name, Response: Message + Name + Default>(
    session: &Session,
    key: &str,
    request: &Request,
) -> Outcome<Response> {
    let replies = session
        .get(key)
        .payload(request.encode_to_vec())
        .encoding(encoding::<Request>())
        .consolidation(ConsolidationMode::None)
        .timeout(Duration::from_secs(3600))
        .wait()?;
    while let Ok(reply) = replies.recv() {
        let sample: &Sample = match reply.result() {
            Ok(sample) => sample,
            Err(error) => return Err(Fault::decode(&*error.payload().to_bytes())?.message.into()),
        };
        let payload = sample.payload().to_bytes();
        match sample.encoding().to_string() {
            it if it == encoding::<Progress>() => {
                let progress = Progress::decode(&*payload)?;
                println!("{} {:.0} %", progress.phase, 100.0 * progress.fraction);
            }
            it if it == encoding::<Response>() => return Ok(Response::decode(&*payload)?),
            other => return Err(format!("{key} answered with {other:?}.").into()),
        }
    }
    Err(format!("{key} ended without an answer.").into())
}

/// Two seconds of a slow sine on every drive, within a twentieth of its limits, from rest to rest.
fn gentle_drive(rig: &RigDescription) -> Record {
    let count = (2.0 * rig.sample_rate) as usize;
    let wave = |i: usize| {
        let share = i as f64 / (count - 1) as f64;
        (TAU * 2.0 * share).sin() * (TAU * share / 2.0).sin().powi(2)
    };
    let row = |channel: &Channel| {
        (0..count)
            .map(move |i| 0.05 * channel.maximum * wave(i))
            .collect::<Vec<f64>>()
    };
    let data = rig.drives.iter().flat_map(row).flat_map(f64::to_le_bytes).collect();
    Record {
        channels: rig.drives.clone(),
        sample_rate: rig.sample_rate,
        samples: Some(Array {
            element_type: ElementType::Float64.into(),
            shape: vec![rig.drives.len() as u64, count as u64],
            data,
        }),
    }
}

/// The elements of an array of doubles; its shape and its bytes must agree.
fn doubles(array: &Array) -> Outcome<Vec<f64>> {
    let (doubles, rest) = array.data.as_chunks::<8>();
    let count: u64 = array.shape.iter().product();
    if array.element_type() != ElementType::Float64 || !rest.is_empty() || doubles.len() as u64 != count {
        return Err("The array is damaged: element type, shape and bytes do not agree.".into());
    }
    Ok(doubles.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
}

fn encoding<M: Name>() -> String {
    format!("application/protobuf;{}", M::full_name())
}
