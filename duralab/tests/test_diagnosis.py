"""What `duralab doctor` finds: each fault is made, and must be found with what to do about it."""

import json
import socket
from pathlib import Path

import pytest
from test_cli import invoke

from duralab.diagnosis import Severity, examine
from duralab.diagnosis.checks import (
    LAB_PORT,
    MEBIBYTE,
    check_bus,
    check_command,
    check_disk,
    check_graphics,
    check_locale,
    check_lock,
    check_own_versions,
    check_ports,
    check_python,
    check_requirements,
    check_services,
    check_shadows,
    check_temporary,
    check_viewer,
    check_writable,
    free_bytes,
    locked_versions,
    named,
    nearest_folder,
    ports_free,
    vulkan_drivers,
)
from duralab_bus import BusError

FREE = {LAB_PORT: True, 9876: True, 9090: True}
FINE, WARNING, PROBLEM = Severity


def test_this_machine_is_examined_and_every_fault_has_a_remedy(tmp_path):
    findings = examine(tmp_path / "not" / "there")
    assert len({finding.check for finding in findings}) == len(findings) >= 15
    assert [finding for finding in findings if (finding.severity is FINE) == bool(finding.remedy)] == []
    assert [finding for finding in findings if finding.check in ("Python", "services", "bus")] != []


def test_the_exit_code_says_whether_a_lab_would_work(monkeypatch, tmp_path):
    from duralab.diagnosis.checks import fine, problem, warning

    found = [fine("a", "well"), warning("b", "half", "mend it")]
    monkeypatch.setattr("duralab.diagnosis.examine", lambda recordings: found)
    code, stdout, _ = invoke("doctor")
    assert code == 0
    assert "→ mend it" in stdout
    found.append(problem("c", "broken", "buy one"))
    code, stdout, _ = invoke("doctor", "--json")
    assert code == 1
    told = json.loads(stdout)
    assert told["works"] is False
    assert told["findings"][2] == {"check": "c", "severity": "problem", "sentence": "broken", "remedy": "buy one"}


@pytest.mark.parametrize(
    ("version", "bits", "severity"), [((3, 11, 4), 64, FINE), ((3, 10, 12), 64, PROBLEM), ((3, 12, 0), 32, PROBLEM)]
)
def test_a_wrong_python_is_found(version, bits, severity):
    assert check_python(version, pointer_bits=bits, executable="python").severity is severity


def test_a_python_without_the_services_is_found():
    assert check_services(lambda name: True, executable="python").severity is FINE
    found = check_services(lambda name: name != "recorder", executable="python")
    assert found.severity is PROBLEM
    assert "python has no recorder" in found.sentence


def test_a_file_that_hides_a_service_is_found(tmp_path):
    assert check_shadows(tmp_path, paths=[""]).severity is FINE
    (tmp_path / "recorder").mkdir()
    assert check_shadows(tmp_path, paths=[]).severity is FINE
    (tmp_path / "recorder" / "__init__.py").touch()
    assert check_shadows(tmp_path, paths=[]).severity is PROBLEM
    assert check_shadows(tmp_path / "elsewhere", paths=[str(tmp_path)]).severity is PROBLEM


def test_a_command_of_another_python_is_found(tmp_path):
    assert check_command(str(tmp_path / "bin" / "duralab"), prefix=tmp_path).severity is FINE
    assert check_command("/usr/bin/duralab", prefix=tmp_path).severity is WARNING
    assert check_command(None, prefix=tmp_path).severity is WARNING


def test_parts_of_different_versions_are_found():
    assert check_own_versions({"duralab": "1.0", "duralab-proto": "1.0", "numpy": "2"}).severity is FINE
    assert check_own_versions({"duralab": "1.0", "duralab-proto": "1.1"}).severity is PROBLEM


def test_a_missing_package_is_found_whatever_its_spelling():
    installed = named([("PyYAML", "6"), ("typing_extensions", "4"), (None, "0")])
    required = ["pyyaml>=5", "typing.Extensions", 'asammdf; extra == "mdf"']
    assert check_requirements(required, installed).severity is FINE
    found = check_requirements([*required, "mcap"], installed)
    assert found.severity is PROBLEM
    assert "Not installed: mcap." in found.sentence


def test_another_version_of_zenoh_is_a_problem_and_of_a_plotter_a_warning():
    locked = locked_versions('eclipse-zenoh==1.10.2 \\\n    --hash=x\ndrake==1.51 ; python_full_version < "3.12"\n')
    locked |= locked_versions('drake==1.58 ; python_full_version >= "3.12"\nplotly==6.0\n') | {
        "drake": {"1.51", "1.58"}
    }
    tested = {"eclipse-zenoh": "1.10.2", "drake": "1.58", "plotly": "6.0", "own": "1"}
    assert check_lock(locked, tested).severity is FINE
    assert check_lock(locked, tested | {"plotly": "5.0"}).severity is WARNING
    found = check_lock(locked, tested | {"plotly": "5.0", "eclipse-zenoh": "1.9.0"})
    assert found.severity is PROBLEM
    assert found.sentence.index("eclipse-zenoh 1.9.0 (tested: 1.10.2)") < found.sentence.index("plotly")
    assert check_lock({}, tested).severity is FINE


def test_one_name_may_be_locked_at_two_versions():
    text = 'drake==1.51 ; python_full_version < "3.12"\ndrake==1.58 ; python_full_version >= "3.12"\n'
    assert locked_versions(text) == {"drake": {"1.51", "1.58"}}


@pytest.mark.parametrize(
    ("free", "severity"), [(200 * MEBIBYTE, PROBLEM), (1000 * MEBIBYTE, WARNING), (9000 * MEBIBYTE, FINE)]
)
def test_a_full_disk_is_found(free, severity, tmp_path):
    assert check_disk(tmp_path, free=free).severity is severity


def test_room_is_measured_where_a_folder_will_be(tmp_path):
    assert nearest_folder(tmp_path / "a" / "b") == tmp_path
    assert free_bytes(tmp_path / "a" / "b") > 0


def test_a_folder_that_cannot_be_written_is_found(tmp_path):
    assert check_writable("x", tmp_path / "new", remedy="").severity is FINE
    found = check_writable("x", Path("/proc/self"), remedy="go elsewhere")
    assert found.severity is PROBLEM
    assert found.remedy == "go elsewhere"
    assert check_temporary(Path("/proc/self"), free=10**12).severity is PROBLEM
    assert check_temporary(tmp_path, free=MEBIBYTE).severity is PROBLEM
    assert check_temporary(tmp_path, free=10**12).severity is FINE


@pytest.mark.parametrize(
    ("encoding", "names", "severity"),
    [("UTF-8", "utf-8", FINE), ("ANSI_X3.4-1968", "utf-8", WARNING), ("utf8", "latin-1", WARNING), ("?", "?", WARNING)],
)
def test_a_locale_that_is_not_utf_8_is_found(encoding, names, severity):
    assert check_locale(encoding, file_names=names).severity is severity


def test_a_port_in_use_is_found_unless_it_is_ones_own_lab():
    assert [finding.severity for finding in check_ports([], is_free=FREE)] == [FINE, FINE]
    taken = FREE | {LAB_PORT: False, 9090: False}
    lab, viewer = check_ports([], is_free=taken)
    assert (lab.severity, viewer.severity) == (PROBLEM, WARNING)
    assert "9090" in viewer.sentence
    lab, _ = check_ports([f"tcp/127.0.0.1:{LAB_PORT}"], is_free=taken)
    assert lab.severity is FINE


def test_a_port_that_somebody_listens_on_is_not_free(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr("duralab.diagnosis.checks.LAB_PORT", port)
        assert ports_free()[port] is False


def test_a_bus_that_cannot_be_opened_is_found(monkeypatch):
    assert check_bus().severity is FINE

    def refuse(*_, **__):
        raise BusError("Cannot listen at tcp/127.0.0.1:0: Permission denied.")

    monkeypatch.setattr("duralab.diagnosis.checks.open_bus", refuse)
    assert check_bus().severity is PROBLEM


@pytest.mark.parametrize(
    ("system", "display", "library", "drivers", "severity"),
    [
        ("linux", False, None, [], FINE),
        ("linux", True, None, [], WARNING),
        ("linux", True, "libvulkan.so.1", [], WARNING),
        ("linux", True, "libvulkan.so.1", ["lvp_icd.x86_64.json"], WARNING),
        ("linux", True, "libvulkan.so.1", ["lvp_icd.x86_64.json", "radeon_icd.x86_64.json"], FINE),
        ("darwin", True, None, [], FINE),
    ],
)
def test_a_missing_graphics_driver_is_found(system, display, library, drivers, severity):
    paths = [Path(name) for name in drivers]
    assert check_graphics(system=system, display=display, library=library, drivers=paths).severity is severity


def test_drivers_are_looked_for_where_vulkan_looks(tmp_path):
    folder = tmp_path / ".local/share/vulkan/icd.d"
    folder.mkdir(parents=True)
    (folder / "own_icd.json").touch()
    assert folder / "own_icd.json" in vulkan_drivers({}, home=tmp_path)
    (tmp_path / "one.json").touch()
    environment = {"VK_DRIVER_FILES": f"{tmp_path / 'one.json'}:{tmp_path / 'none.json'}"}
    assert vulkan_drivers(environment, home=tmp_path) == [tmp_path / "one.json"]


def test_a_missing_viewer_is_found():
    assert check_viewer(None).severity is WARNING
    assert check_viewer(Path("rerun")).severity is FINE
