"""Generate the Python package `duralab_proto.v1` from the contract, or check that it is current."""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path

from grpc_tools import protoc

ROOT = Path(__file__).resolve().parent
PACKAGE = ROOT / "duralab_proto" / "v1"


def generate(target: Path) -> list[Path]:
    """Write the generated modules and stubs into `target` and return their paths, sorted."""
    sources = sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("duralab/v1/*.proto"))
    with tempfile.TemporaryDirectory() as folder:
        status = protoc.main(["protoc", f"-I{ROOT}", f"--python_out={folder}", f"--pyi_out={folder}", *sources])
        if status != 0:
            raise SystemExit(f"protoc ended with status {status}; the lines above say why.")
        written = []
        for path in sorted(Path(folder, "duralab", "v1").iterdir()):
            # The generated imports follow the folder of the .proto files; the package is in another folder,
            # because `duralab` is the SDK's name.
            text = re.sub(r"^from duralab\.v1 import", "from duralab_proto.v1 import", path.read_text(), flags=re.M)
            out = target / path.name
            out.write_text(text)
            written.append(out)
    return written


def check() -> int:
    """Return 0 if the committed package equals the generated one, else print the differing files and return 1."""
    with tempfile.TemporaryDirectory() as folder:
        fresh = {path.name: path.read_bytes() for path in generate(Path(folder))}
    committed = {path.name: path.read_bytes() for path in PACKAGE.glob("*_pb2.py*")}
    stale = sorted(name for name in fresh.keys() | committed.keys() if fresh.get(name) != committed.get(name))
    for name in stale:
        sys.stderr.write(f"{name} is not what the contract generates; run `make proto` and commit it.\n")
    return 1 if stale else 0


def main() -> int:
    """Parse the command line and generate or check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only check that the committed package is current")
    if parser.parse_args().check:
        return check()
    PACKAGE.mkdir(parents=True, exist_ok=True)
    generate(PACKAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
