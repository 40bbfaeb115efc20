"""The notes of labs that run: found while their process lives, never believed afterwards."""

import json
import os
import subprocess
import sys

import psutil
import pytest
from ended_processes import alive
from test_cli import invoke

import duralab
from duralab.errors import InputError, LabError
from duralab.processes import end_lab, noted, notes_folder, running_labs, the_running_lab

ENDPOINT = "tcp/127.0.0.1:4711"


@pytest.fixture(autouse=True)
def notes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "duralab" / "labs"


@pytest.fixture
def sleeper():
    """A process that stands for a lab."""
    with subprocess.Popen(
        [sys.executable, "-c", "import time; print(flush=True); time.sleep(600)"], stdout=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        yield process
        process.kill()


def note(notes, process, *, endpoint=ENDPOINT, **changes):
    content = {
        "endpoint": endpoint,
        "process_id": process.pid,
        "process_began": psutil.Process(process.pid).create_time(),
        "host": os.uname().nodename,
        "recordings": "rec",
        "services": {},
    }
    notes.mkdir(parents=True, exist_ok=True)
    path = notes / f"{endpoint.rpartition(':')[2]}.json"
    path.write_text(json.dumps(content | changes))
    return path


def test_a_lab_is_noted_for_as_long_as_it_runs(tmp_path):
    with noted(ENDPOINT, recordings=tmp_path, services={"recorder": 1}) as fault:
        assert fault is None
        lab = the_running_lab()
        assert (lab.endpoint, lab.process_id, lab.services) == (ENDPOINT, os.getpid(), {"recorder": 1})
        assert notes_folder().stat().st_mode & 0o077 == 0
    assert the_running_lab() is None
    assert list(notes_folder().iterdir()) == []


def test_a_note_that_cannot_be_written_is_said_and_keeps_no_lab_from_running(tmp_path, monkeypatch):
    (tmp_path / "state").write_text("a file is in the way")
    with noted(ENDPOINT, recordings=tmp_path, services={}) as fault:
        assert "`duralab down` will not find this lab" in fault


def test_the_note_of_a_process_that_is_gone_is_removed(notes, sleeper):
    path = note(notes, sleeper)
    assert the_running_lab().process_id == sleeper.pid
    sleeper.kill()
    sleeper.wait()
    assert running_labs() == []
    assert not path.exists()


def test_a_process_that_got_the_same_id_later_is_neither_a_lab_nor_ended(notes, sleeper):
    note(notes, sleeper)
    lab = the_running_lab()
    note(notes, sleeper, process_began=lab.process_began - 60.0)
    assert running_labs() == []
    stale = type(lab)(**{**vars(lab), "process_began": lab.process_began - 60.0})
    end_lab(stale)
    assert alive(sleeper.pid)


@pytest.mark.parametrize("text", ["", "[]", '{"endpoint": 3}', '{"process_id": -1}', "\0"])
def test_a_note_that_is_none_is_passed_over(notes, text):
    notes.mkdir(parents=True)
    (notes / "x.json").write_text(text)
    assert running_labs() == []


def test_notes_of_another_machine_are_left_alone(notes, sleeper):
    path = note(notes, sleeper, host="elsewhere")
    assert running_labs() == []
    assert path.exists()


def test_with_several_labs_one_must_be_named(notes, sleeper):
    note(notes, sleeper)
    note(notes, sleeper, endpoint="tcp/127.0.0.1:4712")
    with pytest.raises(InputError, match=r"2 labs run here: tcp/127\.0\.0\.1:4711, tcp/127\.0\.0\.1:4712; name one"):
        the_running_lab()
    code, _, stderr = invoke("down")
    assert code == 2
    assert "name one of them with --connect" in stderr
    assert alive(sleeper.pid)


def test_down_ends_the_lab_and_its_note_goes(notes, sleeper):
    note(notes, sleeper)
    code, stdout, _ = invoke("down", "--json")
    assert code == 0
    assert json.loads(stdout) == {"ended": [{"endpoint": ENDPOINT, "process_id": sleeper.pid}]}
    # `down` asked how it ended, in this process: only that it did is left to be seen.
    assert not psutil.pid_exists(sleeper.pid)
    assert running_labs() == []
    code, stdout, _ = invoke("down")
    assert (code, stdout) == (0, "None of your labs runs on this machine.\n")


def test_down_names_the_labs_there_are(notes, sleeper):
    note(notes, sleeper)
    code, _, stderr = invoke("down", "--connect", "tcp/127.0.0.1:1")
    assert code == 2
    assert f"listens at tcp/127.0.0.1:1; there are {ENDPOINT}" in stderr
    assert invoke("down", "--connect", ENDPOINT, "--all")[0] == 2
    assert alive(sleeper.pid)
    assert invoke("down", "--all")[0] == 0
    # `down` asked how it ended, in this process: only that it did is left to be seen.
    assert not psutil.pid_exists(sleeper.pid)


def test_a_script_joins_the_one_lab_that_runs(tmp_path):
    with (
        noted(ENDPOINT, recordings=tmp_path, services={}),
        pytest.raises(InputError, match=ENDPOINT),
        duralab.connect(timeout_seconds=1.0),
    ):
        raise AssertionError("nothing listens there")


def test_a_lab_that_has_ended_but_whose_parent_did_not_ask_how_is_gone(notes, sleeper):
    note(notes, sleeper)
    lab = the_running_lab()
    sleeper.kill()
    os.waitid(os.P_PID, sleeper.pid, os.WEXITED | os.WNOWAIT)
    assert psutil.Process(sleeper.pid).status() == psutil.STATUS_ZOMBIE
    assert not lab.runs()
    end_lab(lab, timeout_seconds=0.1)


def test_a_lab_that_does_not_end_is_said(notes):
    code = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
        try:
            process.stdout.readline()
            note(notes, process)
            with pytest.raises(LabError, match=r"did not end within 0\.2 s"):
                end_lab(the_running_lab(), timeout_seconds=0.2)
        finally:
            process.kill()
