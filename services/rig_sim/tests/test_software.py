"""The software's part of a content hash: every change of the sources counts, where a module lies does not."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import duralab_gateway.motion
import rig_sim
from rig_sim.playing.software import software_hash, sources_hash

MOTION = Path(duralab_gateway.motion.__file__).parent


@pytest.fixture
def copy(tmp_path):
    return Path(shutil.copytree(Path(rig_sim.__file__).parent, tmp_path / "rig_sim"))


@pytest.fixture
def motion(tmp_path):
    return Path(shutil.copytree(MOTION, tmp_path / "motion"))


def rewrite(folder, old, new):
    changed = 0
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        changed += text.count(old)
        path.write_text(text.replace(old, new), encoding="utf-8")
    assert changed > 0


def test_a_copy_of_the_sources_has_the_hash_of_the_software(copy):
    assert sources_hash(copy, MOTION) == software_hash()


def test_a_module_that_only_moves_leaves_the_hash_as_it_is(copy):
    (copy / "multibody" / "spatial.py").rename(copy / "elements" / "geometry.py")
    rewrite(copy, "rig_sim.multibody.spatial", "rig_sim.elements.geometry")
    assert sources_hash(copy, MOTION) == software_hash()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("_GROWTH = 1.0e-6", "_GROWTH = 2.0e-6"),
        ("from rig_sim.compile import atan2, cos, sin, sqrt", "from rig_sim.compile import cos, sin, sqrt"),
        ("import numpy as np\n", "import numpy as np\nimport math\n"),
    ],
)
def test_a_change_of_what_a_module_says_changes_the_hash(copy, old, new):
    rewrite(copy, old, new)
    assert sources_hash(copy, MOTION) != software_hash()


def test_two_modules_that_say_the_same_are_not_one(copy):
    shutil.copy(copy / "multibody" / "spatial.py", copy / "multibody" / "another.py")
    assert sources_hash(copy, MOTION) != software_hash()


def test_a_change_of_the_way_to_the_first_sample_changes_the_hash(copy, motion):
    assert sources_hash(copy, motion) == software_hash()
    rewrite(motion, "0.5 * (1.0 - np.cos(", "0.4 * (1.0 - np.cos(")
    assert sources_hash(copy, motion) != software_hash()


def test_a_rig_is_loaded_without_a_bus():
    loaded = "import sys, rig_sim; sys.exit(bool({'zenoh', 'google.protobuf'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", loaded], check=False).returncode == 0
