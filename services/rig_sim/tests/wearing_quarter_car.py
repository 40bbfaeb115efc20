"""The quarter car of the guide with parts that wear: its static deflections and loads are known in closed form."""

import re
from pathlib import Path

import yaml

GUIDE = Path(__file__).resolve().parents[3] / "docs" / "guides" / "own-specimen.md"
FILES = dict(re.findall(r"```\w+ file=(\S+)\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.S))

TYRE = {
    "name": "tyre",
    "kind": "softening",
    "part": {"frame_a": "pan", "frame_c": "contact", "axis": "z"},
    "load": "force",
    "exponent": 3.0,
    "reference_range": 1000.0,
    "reference_cycles": 100.0,
    "stiffness_lost": 0.4,
    "damping_lost": 0.5,
}
STRUT = TYRE | {"name": "damper", "part": {"strut": "strut"}, "load": "deflection", "reference_range": 0.01}
STRUT = {key: value for key, value in STRUT.items() if key != "stiffness_lost"}
GAIN = {"name": "gain", "kind": "gain_drift", "channel": "vertical", "per_run": 0.01}


def quarter_car(folder, *wear, **changes):
    """Write the quarter car with some wear, and without noise."""
    document = yaml.safe_load(FILES["quarter_car.yaml"]) | {"wear": list(wear)} | changes
    document["responses"][0]["noise_rms"] = 0.0
    (folder / "quarter_car.sdf").write_text(FILES["quarter_car.sdf"])
    path = folder / "quarter_car.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path
