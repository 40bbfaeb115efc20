"""A lab and a folder of recordings belong to one recorder at a time."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from duralab_bus import BusConfig, ConfigError, open_bus
from recorder.log import exclusive_folder


def test_a_second_recorder_is_kept_out_until_the_first_has_ended(tmp_path):
    folder = tmp_path / "recordings"
    refused = pytest.raises(ConfigError, match=r"Another recorder writes in folder '.*recordings'; end it first")
    with exclusive_folder(folder), refused, exclusive_folder(folder):
        pytest.fail("Two recorders have one folder.")
    with exclusive_folder(folder):
        assert not (folder / ".writable").exists()


@pytest.fixture
def command(tmp_path):
    """How to start a recorder with some settings."""

    def write(name, **settings):
        config = tmp_path / name
        config.write_text(json.dumps(settings))
        return [sys.executable, "-m", "recorder", "--config", str(config)]

    return write


def test_a_second_one_of_a_lab_or_of_a_folder_ends_at_once_with_a_sentence(tmp_path, command):
    with open_bus(BusConfig(lab="test"), service="duralab") as bus:
        peers = {"lab": "test", "connect": [bus.listening[0]]}
        first = subprocess.Popen(command("first.yaml", bus=peers, folder=str(tmp_path / "recordings")))
        try:
            bus.wait_for_live({("recorder", "main")}, 120.0)
            for settings, why in (
                ({"bus": peers, "folder": "elsewhere"}, "Another recorder is on the bus of lab 'test'; end it first."),
                ({"bus": {"lab": "another"}, "folder": "recordings"}, "Another recorder writes in folder 'recordings'"),
            ):
                second = subprocess.run(
                    command("second.yaml", **settings),
                    cwd=tmp_path,
                    stderr=subprocess.PIPE,
                    text=True,
                    timeout=120,
                    check=False,
                )
                assert second.returncode == 2
                assert why in second.stderr.splitlines()[-1]
            assert first.poll() is None
        finally:
            first.kill()
            first.wait()
