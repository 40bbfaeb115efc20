"""The health check of a container: exit code 0 for who answers, 1 for who does not, 2 for a wrong configuration."""

import os
import subprocess
import sys

import pytest


def check(*arguments, **variables):
    return subprocess.run(
        [sys.executable, "-m", "duralab_bus.health", *arguments],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture
def joining(hub):
    return {"DURALAB__BUS__CONNECT": f'["{hub.listening[0]}"]'}


def test_service_that_answers_is_healthy(hub, bench, joining):
    checked = check("rig_sim", "bench", **joining)
    assert (checked.returncode, checked.stderr) == (0, "")


def test_service_that_is_not_there_is_sick(hub, joining):
    checked = check("rig_sim", "bench", "--timeout", "0.5", **joining)
    assert checked.returncode == 1
    assert checked.stderr.startswith("Not on the bus after 0.5 s: rig_sim/bench")


def test_bus_that_is_away_is_sick():
    checked = check("rig_sim", "bench", "--timeout", "0.5", DURALAB__BUS__CONNECT='["tcp/127.0.0.1:1"]')
    assert checked.returncode == 1
    assert "tcp/127.0.0.1:1" in checked.stderr


def test_configuration_that_connects_to_nobody_is_refused():
    checked = check("rig_sim", "bench")
    assert checked.returncode == 2
    assert "connects to no endpoint" in checked.stderr


def test_settings_of_the_service_itself_are_none_of_the_check(hub, bench, joining, tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text("rigs: [bench]\nworkers: 2\n")
    checked = check("rig_sim", "bench", "--config", str(file), DURALAB__RIGS='["bench"]', **joining)
    assert (checked.returncode, checked.stderr) == (0, "")
