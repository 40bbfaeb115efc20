"""A configuration that cannot be served: one sentence on standard error, exit code 2."""

import subprocess
import sys

import pytest
import yaml

WAIT = 120.0


def start(folder, config):
    path = folder / "rig_sim.yaml"
    path.write_text(yaml.safe_dump(config))
    command = [sys.executable, "-m", "rig_sim", "--config", str(path)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"rigs": ["rear_axle"]}, "rear_axle is not a rig of this simulator; it ships "),
        ({"rigs": []}, "rigs and specimens are both empty; name at least one rig"),
        ({"rigs": ["front_axle", "front_axle"]}, "two rigs are called 'front_axle'; names must differ."),
        (
            {"rigs": [], "specimens": ["nowhere.yaml"]},
            "specimen nowhere.yaml cannot be read: there is no such file.",
        ),
        ({"rig": "front_axle"}, "unknown key 'rig'; allowed: "),
        (
            {"rigs": ["front_axle"], "faults": {"front_axle": [{"kind": "stuck_sensor", "channel": "mid"}]}},
            "fault stuck_sensor of front_axle names 'mid'; there are left_vertical",
        ),
        (
            {"rigs": ["front_axle"], "faults": {"rear_axle": [{"kind": "supply_sag", "share": 0.5}]}},
            "faults: rear_axle is not a rig served here; those are front_axle.",
        ),
        ({"faults": {"front_axle": [{"kind": "meteorite"}]}}, "meteorite"),
    ],
)
def test_a_bad_configuration_is_one_sentence_and_exit_code_two(tmp_path, config, said):
    process = start(tmp_path, config)
    _, error = process.communicate(timeout=WAIT)
    assert process.returncode == 2
    assert error.count("\n") == 1
    assert said in error
