"""Compiled code that is kept: the same bytes as what was compiled, and never anything else."""

import os
import subprocess
import sys

import numpy as np
import pytest
from structlog.testing import capture_logs

from rig_sim.compile import FOLDER_VARIABLE, cached_model, compile_model, sin


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "code"))
    return tmp_path / "code"


class Compiler:
    """Compiles a pendulum, and counts how often."""

    def __init__(self, stiffness=4.0):
        self.stiffness, self.times = stiffness, 0

    def __call__(self):
        self.times += 1
        return compile_model(
            lambda s, u: ([s[1], u[0] - self.stiffness * sin(s[0])], [s[0], 3.0 * s[1]]),
            state_names=["angle", "rate"],
            input_names=["torque"],
            output_names=["angle", "three rates"],
        )


def played(model):
    commands = np.random.default_rng(7).standard_normal((1, 201))
    return model.play([0.3, 0.0], commands, sample_interval=0.01, substeps=3).outputs


def test_a_kept_model_plays_the_same_bytes_and_is_compiled_once(folder):
    compiler = Compiler()
    first, second = cached_model("pendulum", compiler), cached_model("pendulum", compiler)
    assert compiler.times == 1
    assert played(first).tobytes() == played(second).tobytes() == played(Compiler()()).tobytes()
    assert (second.state_names, second.input_names) == (first.state_names, first.input_names)
    assert (second.output_names, second.operation_count) == (first.output_names, first.operation_count)
    assert (second.state_order, second.lanes) == (first.state_order, first.lanes)
    assert [file.stat().st_mode & 0o777 for file in folder.iterdir()] == [0o600]


def test_another_key_is_another_model(folder):
    soft, stiff = cached_model("soft", Compiler(1.0)), cached_model("stiff", Compiler(9.0))
    assert not np.array_equal(played(soft), played(stiff))
    assert len(list(folder.iterdir())) == 2


def test_another_process_finds_it(folder):
    cached_model("pendulum", Compiler())
    program = (
        "from rig_sim.compile import cached_model\n"
        "def compile_it(): raise SystemExit('compiled again')\n"
        "print(cached_model('pendulum', compile_it).derivative([0.0, 2.0], [5.0]))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[2. 5.]", done.stderr


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-1],
        lambda content: content[:100],
        lambda content: b"",
        lambda content: content[:-50] + b"x" + content[-49:],
        lambda content: b"[]\n" + content,
    ],
)
def test_a_damaged_file_is_said_and_compiled_again(folder, damage):
    compiler = Compiler()
    cached_model("pendulum", compiler)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    with capture_logs() as logs:
        again = cached_model("pendulum", compiler)
    assert compiler.times == 2
    assert [log["event"] for log in logs] == ["Compiled code is not used."]
    assert played(again).tobytes() == played(Compiler()()).tobytes()
    assert file.read_bytes() == whole


@pytest.mark.parametrize("of_folder", [False, True])
def test_code_that_others_may_write_is_not_run(folder, of_folder):
    compiler = Compiler()
    cached_model("pendulum", compiler)
    (file,) = folder.iterdir()
    (folder if of_folder else file).chmod(0o777)
    with capture_logs() as logs:
        cached_model("pendulum", compiler)
    assert compiler.times == 2
    assert "others may write" in logs[0]["event"]


def test_without_a_folder_every_model_is_compiled(folder, monkeypatch):
    compiler = Compiler()
    monkeypatch.setenv(FOLDER_VARIABLE, "off")
    cached_model("pendulum", compiler)
    cached_model("pendulum", compiler)
    assert compiler.times == 2
    assert not folder.exists()


def test_a_place_that_cannot_be_written_is_said(folder):
    folder.write_text("no folder")
    with capture_logs() as logs:
        cached_model("pendulum", Compiler())
    assert "Compiled code is not kept." in [log["event"] for log in logs]


def test_the_code_that_was_not_used_for_longest_goes(folder, monkeypatch):
    monkeypatch.setattr("rig_sim.compile.code_cache.MOST_FILES", 2)
    for age, key in ((30, "a"), (20, "b")):
        cached_model(key, Compiler())
        newest = max(folder.iterdir(), key=lambda file: file.stat().st_mtime)
        os.utime(newest, (1e9 - age, 1e9 - age))
    compiler = Compiler()
    cached_model("a", compiler)  # Used again: now "b" is the oldest.
    assert compiler.times == 0
    cached_model("c", Compiler())
    cached_model("a", compiler)
    assert compiler.times == 0
    cached_model("b", compiler)
    assert compiler.times == 1
