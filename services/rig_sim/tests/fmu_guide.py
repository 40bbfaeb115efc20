"""The YAML of the guide to rigs in FMUs, and the folder of its FMU."""

import re
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = ROOT / "examples" / "fmu_rig"


def document():
    text = (ROOT / "docs" / "guides" / "fmu-rig.md").read_text(encoding="utf-8")
    return yaml.safe_load(re.findall(r"```yaml file=two_post\.yaml\n(.*?)```", text, flags=re.S)[0])
