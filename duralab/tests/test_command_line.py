"""The command line as a whole: help, exit codes, errors, JSON, completion, and how little it takes to start."""

import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import COMMAND, invoke

from duralab.cli.commands import SECTIONS, command_function
from duralab.cli.ending import MEANINGS, ExitCode
from duralab.cli.output import write_json
from duralab.python_version import python_fault

ROOT = Path(__file__).resolve().parents[2]
NAMES = [name for commands in SECTIONS.values() for name in commands]

HEAVY = {
    "numpy",
    "scipy",
    "zenoh",
    "plotly",
    "xarray",
    "pydantic",
    "google",
    "mcap",
    "jinja2",
    "pint",
    "yaml",
    "psutil",
}
"""What takes a tenth of a second or more to import, and what such a package imports first."""


def modules_after(code):
    """Return the packages that a fresh Python has imported after some code."""
    asked = f"{code}\nimport sys\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_importing_the_package_imports_nothing_heavy():
    assert modules_after("import duralab") & (HEAVY | {"typer", "rich"}) == set()


def run_in_one_process(*command_lines):
    """Return code that runs command lines one after the other."""
    return f"""
import contextlib, sys
from duralab.cli import main
for arguments in {list(command_lines)!r}:
    sys.argv = ["duralab", *arguments]
    with contextlib.suppress(SystemExit):
        main()
"""


def test_help_imports_nothing_heavy_and_draws_nothing():
    found = modules_after(run_in_one_process(["--help"]))
    assert "typer" in found
    assert found & (HEAVY | {"rich", "pygments", "markdown_it"}) == set()


def test_the_help_of_no_command_imports_what_it_needs_to_run():
    found = modules_after(run_in_one_process(*([*name.split(), "--help"] for name in NAMES)))
    # typer itself checks values with pydantic where that is installed.
    assert found & (HEAVY - {"pydantic"}) == set()


def test_every_public_name_is_found_when_it_is_asked_for():
    import duralab

    assert [name for name in duralab.__all__ if getattr(duralab, name, None) is None] == []
    with pytest.raises(AttributeError, match="no attribute 'conect'"):
        duralab.conect  # noqa: B018


@pytest.mark.parametrize("command", NAMES)
def test_every_command_has_json_and_a_line_of_help_and_fits_80_columns(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    function = command_function(command)
    assert "as_json" in inspect.signature(function).parameters
    code, shown, _ = invoke(*command.split(), "--help")
    assert code == 0
    assert [line for line in shown.splitlines() if len(line) > 80] == []
    assert "--json" in shown
    assert (function.__doc__ or "").splitlines()[0].split()[0] in shown


def test_the_table_of_exit_codes_is_that_of_the_code():
    table = (ROOT / "docs/reference/exit_codes.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| (\d+) \| ([^|]+) \|", table)
    assert [(int(code), meaning.strip()) for code, meaning in rows] == [
        (int(code), meaning) for code, meaning in MEANINGS.items()
    ]
    assert set(MEANINGS) == set(ExitCode)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["fly"], "No such command 'fly'; `duralab --help` shows what is allowed."),
        (["catalog"], "No such command 'catalog'. Did you mean 'catalogue'? `duralab --help` shows what is allowed."),
        (["run"], "`duralab run --help` shows what is allowed."),
        (["run", "x", "--fast"], "No such option: --fast"),
        (["resume", "x", "--from", "many"], "Invalid value for '--from'"),
        (["catalogue", "--result", "odd"], "Invalid value for '--result'"),
    ],
)
def test_a_wrong_command_line_is_one_sentence_as_every_other_error(arguments, said):
    code, stdout, stderr = invoke(*arguments)
    assert code == 2
    assert stdout == ""
    assert stderr.startswith("Error: ")
    assert stderr.count("\n") == 1
    assert said in stderr


@pytest.mark.parametrize("arguments", [["run", "nowhere.yaml"], ["report", "nowhere.mcap"], ["verify", "x"], ["run"]])
def test_with_json_an_error_is_a_document_too(arguments):
    code, stdout, stderr = invoke(*arguments, "--json")
    assert code == 2
    error = json.loads(stdout)["error"]
    assert error["exit_code"] == 2
    assert stderr == f"Error: {error['message']}\n"


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["run", "front_axel_demo"], "front_axle_demo"),
        (["run", "front_axle_demo.yaml"], "front_axle_demo"),
        (["run", "mien.yaml"], "mine.yaml"),
        (["resume", "x", "--settings", "mine.yml"], "mine.yaml"),
        (["sweep", "mien.yaml"], "mine.yaml"),
        (["identify", "front_axle", "--settings", "mien.yaml"], "mine.yaml"),
        (["report", "uot/Recordin.mcap"], "out/recording.mcap"),
        (["compare", "out/recording.mcap", "out/recordings.mcap"], "out/recording.mcap"),
        (["verify", "out/recoding.mcap"], "out/recording.mcap"),
        (["view", "out/live.rdr"], "out/live.rrd"),
        (["convert", "raod.csv", "x.mat"], "road.csv"),
        (["convert", "road.cvs", "x.mat"], "road.csv"),
        (["import", "raod.csv", "x.mat", "--rig", "front_axle"], "road.csv"),
    ],
)
def test_a_mistyped_file_is_asked_about(tmp_path, monkeypatch, recording_path, arguments, meant):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "recording.mcap").symlink_to(recording_path)
    for name in ("mine.yaml", "road.csv", "out/live.rrd"):
        (tmp_path / name).write_text("")
    monkeypatch.chdir(tmp_path)
    code, _, stderr = invoke(*arguments)
    assert code == 2
    assert stderr.endswith(f"; did you mean {meant!r}?\n")
    assert stderr.count("\n") == 1


def test_no_file_is_guessed_that_is_not_similar(tmp_path, monkeypatch):
    (tmp_path / "thesis.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    assert "did you mean" not in invoke("run", "road.yaml")[2] + invoke("report", "nowhere/else/recording.mcap")[2]


def test_where_no_lab_runs_a_command_says_how_to_start_one():
    for arguments in (["catalogue"], ["verify", "x"], ["stop", "x"], ["resume", "x"], ["reset", "front_axle"]):
        code, _, stderr = invoke(*arguments)
        assert code == 2
        assert "start one with `duralab up`" in stderr


def test_a_file_that_cannot_be_read_is_a_sentence(tmp_path):
    folder = tmp_path / "a.yaml"
    folder.mkdir()
    assert invoke("identify", "front_axle", "--settings", folder)[0] == 2
    code, _, stderr = invoke("init", tmp_path / "a.yaml" / "b" / ("n" * 300))
    assert code in (1, 2)
    assert "Traceback" not in stderr
    assert stderr.count("\n") == 1


def test_json_knows_no_nan_and_no_paths(capsys):
    import numpy as np

    write_json({"a": [np.float64("nan"), np.int64(3), True, None], "b": Path("x"), "c": np.eye(2)}, on_one_line=True)
    assert json.loads(capsys.readouterr().out) == {"a": [None, 3, True, None], "b": "x", "c": [[1, 0], [0, 1]]}


def test_the_version_is_told():
    code, stdout, _ = invoke("--version")
    assert code == 0
    assert re.fullmatch(r"duralab \d+\.\d+\.\d+(\.dev\d+\+g[0-9a-f]+)?\n", stdout)


def completed(words):
    """Return what bash would offer for a command line."""
    environment = {
        **os.environ,
        "_DURALAB_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    code = "import sys; sys.argv = ['duralab']; from duralab.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    return done.stdout.split()


def test_a_shell_completes_commands_options_and_shipped_campaigns():
    assert completed("duralab re") == ["reset", "resume", "report"]
    assert "--connect" in completed("duralab status --")
    assert completed("duralab run front") == ["front_axle_demo"]


def test_a_command_ends_with_its_code_after_all_that_waits_for_the_exit_and_without_the_interpreters_own_end():
    code = """
import atexit, sys
from duralab.cli import main

class Module:
    def __del__(self):
        print("searched")

kept = Module()
atexit.register(print, "before the command")
try:
    sys.argv = ["duralab", *sys.argv[1:]]
    main()
finally:
    atexit.register(print, "written")
"""
    for arguments, expected in ((["--version"], 0), (["--nonsense"], 2)):
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == expected
        assert done.stdout.splitlines()[-1] == "written"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of Windows report no reader that is gone")
@pytest.mark.parametrize(
    ("arguments", "code"), [(["--help"], 141), (["--version"], 141), (["doctor"], 141), (["run", "nowhere.yaml"], 2)]
)
@pytest.mark.parametrize("errors_too", [False, True])
def test_a_command_whose_reader_ended_first_ends_without_a_message_and_no_error_loses_its_code(
    arguments, code, errors_too
):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as closed:
        errors = closed if errors_too else subprocess.PIPE
        done = subprocess.run([*COMMAND, *arguments], stdout=closed, stderr=errors, text=True, check=False)
    assert done.returncode == code
    assert errors_too or done.stderr.startswith("Error: ") == (code == 2)
    assert errors_too or done.stderr.count("\n") == (code == 2)


def test_an_old_python_is_told_so():
    assert python_fault((3, 11, 0)) is None
    assert python_fault((3, 10, 12)) == "This is Python 3.10.12; duralab needs 3.11 or later."


def test_a_terminal_without_a_star_is_no_reason_for_a_traceback(tmp_path):
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(
        [*COMMAND, "init", "★.yaml"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "?.yaml: campaign campaign; run it:" in done.stdout


@pytest.mark.parametrize("command", ["up", "play", "run"])
def test_a_rig_that_is_not_shipped_is_said_before_a_lab_is_started(tmp_path, monkeypatch, command):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "duralab.processes.service_programs.shipped_rigs", lambda: dict.fromkeys(("front_axle", "predecessor"), "")
    )
    drive, campaign = tmp_path / "drive.csv", tmp_path / "campaign.yaml"
    drive.write_text("time [s],vertical [m]\n0,0\n0.001,0\n")
    assert invoke("init", campaign)[0] == 0
    campaign.write_text(re.sub(r"(?m)^rig: \w+", "rig: frontaxle", campaign.read_text()))
    arguments = {"up": ["--rig", "frontaxle"], "play": ["frontaxle", drive], "run": [campaign]}[command]
    code, _, stderr = invoke(command, *arguments)
    assert code == 2
    assert "There is no rig 'frontaxle' to start a lab with; there are front_axle, predecessor" in stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["campaign.yaml", "drive.csv"]


def test_status_of_a_lab_that_is_not_there_ends_as_the_table_says():
    code, _, stderr = invoke("status", "--connect", "tcp/127.0.0.1:9")
    assert code == 1
    assert "tcp/127.0.0.1:9" in stderr
    assert invoke("status", "--connect", "nowhere")[0] == 2
