"""Shipped YAML files: numbers as read here are those of a plain reader."""

from pathlib import Path

import pytest
import yaml

from duralab_settings import parse_yaml

ROOT = Path(__file__).parents[1]
FILES = [
    *ROOT.glob("duralab/duralab/**/shipped*/**/*.yaml"),
    *ROOT.glob("services/rig_sim/rig_sim/specimen/shipped/*.yaml"),
    *ROOT.glob("examples/**/*.yaml"),
]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_shipped_file_has_the_same_values_by_yaml_1_1(path):
    text = path.read_text(encoding="utf-8")
    # The text of a value distinguishes 1 from 1.0 and True.
    assert repr(parse_yaml(text)) == repr(yaml.safe_load(text))


def test_the_shipped_files_are_found():
    assert len(FILES) >= 20
