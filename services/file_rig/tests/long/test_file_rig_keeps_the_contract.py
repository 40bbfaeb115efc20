"""check-rig judges file_rig, with a controller that takes as long as a real one."""

from file_lab import Controller
from typer.testing import CliRunner

from duralab.cli.application import app


def test_check_rig_finds_nothing(lab):
    with Controller(lab.map, real_time=True).running() as controller:
        result = CliRunner().invoke(app, ["check-rig", "beam", "--connect", lab.bus.listening[0]])
    assert result.exit_code == 0, result.stdout + result.stderr
    assert len(controller.played) == len(set(controller.played))
