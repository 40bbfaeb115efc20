"""A rig in an FMU: what it plays against its own equations, what becomes of its faults, what is refused."""

import re
import sys
import threading
import zipfile

import numpy as np
import psutil
import pytest
from fmu_guide import document

import rig_sim.fmu.process
from duralab_gateway.motion import WatchdogMonitor
from rig_sim import RigFaultError, SpecimenError, load_any_rig
from rig_sim.bus import describe_rig
from rig_sim.fmu.model_description import _EXPONENTS, _plain
from rig_sim.specimen.responses import UNIT_OF

RATE = 1000.0
#: As two_post.c has them.
NONE, CRASH, EXIT, HANG, REFUSE, NOT_A_NUMBER, VARY = range(7)


def drive(samples=1234, size=0.02):
    time = np.arange(samples) / RATE
    return size * np.array([np.sin(2 * np.pi * 7.0 * time), np.sin(2 * np.pi * 4.0 * time)])


def played(rig, given, seed=1):
    playback = rig.playback(given, seed=seed)
    return playback, list(playback.blocks())


@pytest.fixture
def responses():
    return [{**channel, "noise_rms": 0.0} for channel in measured()]


def forces(drive, *, steps, stiffness=4.0e5):
    """Play the equations of two_post.c: response k belongs to the state at drive sample k."""
    frequency, damping, step = 251.0, 0.7, 2.5e-4
    position, speed, measured = np.zeros(2), np.zeros(2), []
    ahead = np.column_stack([drive[:, 1:], drive[:, -1]])
    for here, following in zip(drive.T, ahead.T, strict=True):
        arch = position + 300.0 * position**3 - 0.2 * position[::-1]
        measured.append(stiffness * arch + 600.0 * speed)
        for index in range(steps):
            command = here + index / steps * (following - here)
            for _ in range(round(1e-3 / steps / step)):
                speed = speed + step * (frequency**2 * (command - position) - 2.0 * damping * frequency * speed)
                position = position + step * speed
    return np.array(measured).T


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("steps", [1, 4])
def test_each_response_sample_belongs_to_its_drive_sample(write, responses, fmi, steps):
    rig = load_any_rig(write(fmi=fmi, responses=responses, step=1e-3 / steps, start_values={"stiffness": 3.0e5}))
    playback, blocks = played(rig, drive())
    np.testing.assert_allclose(playback.response, forces(drive(), steps=steps, stiffness=3.0e5), rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive())
    assert rig.engine_name == f"FMI {fmi}.0 co-simulation"


def test_two_plays_of_one_drive_have_the_same_bytes_however_it_is_cut(write):
    rig = load_any_rig(write())
    first, again, other = (played(rig, drive(), seed)[0].response for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes() != other.tobytes()
    cut = rig.playback(drive(), seed=1)
    cut.cut(0.007)
    assert len(list(cut.blocks())) == 177
    assert cut.response.tobytes() == first.tobytes()


def test_the_content_hash_is_of_fmu_and_yaml(write):
    digest = load_any_rig(write()).content_hash
    assert load_any_rig(write()).content_hash == digest
    assert load_any_rig(write(title="Another")).content_hash != digest
    assert load_any_rig(write(fmi=3)).content_hash != digest


def test_it_describes_itself_as_other_rigs_do_and_is_watched(write):
    rig = load_any_rig(write())
    told = describe_rig(rig)
    assert [(c.name, c.unit, c.holds_static) for c in told.drives] == [("front", "m", True), ("rear", "m", True)]
    assert [(c.name, c.unit, c.watchdog) for c in told.responses] == [("front", "N", 3e4), ("rear", "N", 3e4)]
    assert told.specimen == "Beam on two cylinders"
    monitor = WatchdogMonitor(rig.watchdogs, sample_rate=RATE)
    trips = [monitor.first_trip(block) for block in played(rig, drive(size=0.049))[1]]
    assert any(trip and trip.watchdog.name in ("front", "rear") for trip in trips)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (CRASH, r"crashed \(SIGSEGV\)"),
        (EXIT, "ended its process with exit code 3"),
        (HANG, "did not answer for 2 s and was ended"),
        (REFUSE, r"failed to do a step at its time 1\.2\d\d s \(status 3\)"),
        (NOT_A_NUMBER, r"gave nan for front at 1\.2\d\d s, which is no finite value"),
    ],
)
@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_that_fails_breaks_one_run_off_and_the_next_one_plays(write, monkeypatch, fmi, fault, said):
    rig = load_any_rig(write(fmi=fmi, start_values={"fault": fault, "fault_above": 0.015}))
    gentle = drive(size=0.01)
    before = played(rig, gentle)[0].response
    playback = rig.playback(np.hstack([gentle, drive()]), seed=1)
    blocks = playback.blocks()
    next(blocks)
    if fault == HANG:
        monkeypatch.setattr(rig_sim.fmu.process, "LONGEST_SILENCE_SECONDS", 2.0)
    with pytest.raises(RigFaultError, match=said) as caught:
        list(blocks)
    monkeypatch.undo()
    assert re.fullmatch(
        r"two_post\.fmu .*, in the block that began at 1\.2\d\d s; see to the FMU and reset two_post, the next run "
        r"begins a new process\.",
        str(caught.value),
    )
    assert "\n" not in str(caught.value)
    assert playback.samples_done == 1200
    np.testing.assert_array_equal(playback.response[:, :1200], before[:, :1200])
    assert played(rig, gentle)[0].response.tobytes() == before.tobytes()


def test_a_process_that_is_killed_in_mid_run_breaks_it_off(write):
    rig = load_any_rig(write())
    playback = rig.playback(drive(), seed=1)
    blocks = playback.blocks()
    next(blocks)
    (child,) = [child for child in psutil.Process().children() if "child.py" in " ".join(child.cmdline())]
    child.kill()
    with pytest.raises(RigFaultError, match=r"two_post\.fmu crashed \(SIGKILL\), in the block that began at 0\.100 s"):
        list(blocks)


def test_no_process_outlives_its_playback(write):
    rig = load_any_rig(write())
    playback = rig.playback(drive(), seed=1)
    next(playback.blocks())
    assert [c for c in psutil.Process().children() if "child.py" in " ".join(c.cmdline())]
    del playback
    assert [c for c in psutil.Process().children() if "child.py" in " ".join(c.cmdline())] == []


def test_an_fmu_that_answers_one_drive_in_two_ways_is_served_and_says_so(write):
    rig = load_any_rig(write(start_values={"fault": VARY}))
    assert re.fullmatch(
        r"Beam on two cylinders \[NOT REPEATABLE: (front|rear) differed by \S+ N between two runs of one drive\]",
        describe_rig(rig).specimen,
    )


def test_one_that_fails_when_it_is_tried_is_refused(write):
    with pytest.raises(SpecimenError, match=r"specimen two_post: two_post\.fmu crashed \(SIGSEGV\)\."):
        load_any_rig(write(start_values={"fault": CRASH}))


def test_sensors_break_as_those_of_other_rigs_do(write, responses):
    from pydantic import TypeAdapter

    from rig_sim.playing.faults import Fault

    fault = TypeAdapter(Fault).validate_python({"kind": "stuck_sensor", "channel": "rear", "start": 0.5})
    rig = load_any_rig(write(responses=responses), faults={"two_post": (fault,)})
    response = played(rig, drive())[0].response
    assert np.ptp(response[1, 500:]) == 0.0 < np.ptp(response[0, 500:])


def changed(channels, row, **changes):
    return [{**channel, **(changes if index == row else {})} for index, channel in enumerate(channels)]


def drives():
    return document()["drives"]


def measured():
    return document()["responses"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fmu": "missing.fmu"}, "missing.fmu does not lie beside two_post.yaml."),
        ({"fmu": "../two_post.fmu"}, "fmu is '../two_post.fmu'"),
        ({"step": 3.0e-4}, "step is 0.0003 s; a whole number of steps must make a sample interval of 0.001 s"),
        ({"step": 2.0e-3}, "step is 0.002 s; a whole number of steps must make"),
        ({"settling": -1.0}, "settling is -1.0"),
        (
            {"drives": changed(drives(), 0, variable="front.strok")},
            "drive front is the variable 'front.strok', which the FMU has not; of the causality input are front.stroke",
        ),
        (
            {"drives": changed(drives(), 0, variable="front.force")},
            "drive front is the variable 'front.force', whose causality is output; it must be input.",
        ),
        (
            {"responses": changed(measured(), 1, variable="rear.stroke")},
            "response rear is the variable 'rear.stroke', whose causality is input; it must be output.",
        ),
        (
            {"responses": changed(measured(), 1, quantity="moment")},
            "response rear is the variable 'rear.force', whose unit is 'N', and the channel is in N*m",
        ),
        ({"drives": changed(drives(), 1, variable="front.stroke")}, "two drives move the variable 'front.stroke'"),
        ({"responses": changed(measured(), 1, name="front")}, "two responses are called 'front'"),
        ({"start_values": {"stifness": 1.0}}, "start_values names 'stifness', which the FMU has not; of the causality"),
        ({"start_values": {"front.force": 1.0}}, "whose causality is output; it must be parameter or input."),
        ({"start_values": {"front.stroke": 1.0}}, "start_values has 'front.stroke', which a drive moves"),
        ({"start_values": {"stiffness": "hard"}}, "start_values.stiffness is 'hard'"),
        ({"sdf": "front_axle.sdf"}, "unknown key 'sdf'"),
        ({"watchdogs": {"responses": {"middle": 1.0}}}, "'middle'; there are front, rear"),
        ({"without": ["responses"]}, "responses is missing"),
    ],
)
def test_a_yaml_that_does_not_fit_is_refused_in_one_sentence(write, changes, said):
    with pytest.raises(SpecimenError, match=re.escape(said)) as caught:
        load_any_rig(write(**changes))
    assert str(caught.value).startswith("specimen two_post")
    assert re.search(r"[.?]$", str(caught.value))
    assert "\n" not in str(caught.value)


def test_an_engine_is_no_matter_of_an_fmu(write):
    from rig_sim import EngineChoice

    with pytest.raises(SpecimenError, match="two_post is played by its FMU and takes no engine"):
        load_any_rig(write(), engines={"two_post": EngineChoice()})


def rewritten(path, change):
    """Write an FMU again with other names and contents of its members; None leaves one out."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            if (kept := change(name, content)) is not None:
                archive.writestr(*kept)


def in_description(old, new):
    def change(name, content):
        if name != "modelDescription.xml":
            return name, content
        assert old.encode() in content
        return name, content.replace(old.encode(), new.encode())

    return change


def on_windows(name, content):
    return re.sub("binaries/.*", "binaries/win64/two_post.dll", name), content


LIBRARY = "two_post.dylib" if sys.platform == "darwin" else "two_post.so"


@pytest.mark.parametrize(
    ("fmi", "change", "said"),
    [
        (2, on_windows, r"two_post\.fmu has libraries for win64, and this machine is \w+; export it for \w+\."),
        (3, on_windows, r"two_post\.fmu has libraries for win64, and this machine is [\w-]+; export it for [\w-]+\."),
        (
            2,
            lambda name, content: (name, content) if "xml" in name else ("sources/a.c", b""),
            "libraries for no platform",
        ),
        (
            2,
            lambda name, content: (name.replace("two_post.", "other."), content),
            r"has no binaries/\w+/two_post\.\w+, where",
        ),
        (
            2,
            lambda name, content: (name, b"\x7fELF" if "xml" not in name else content),
            f"Failed to load shared library binaries/.*{LIBRARY}",
        ),
        (2, lambda name, content: (name, content) if "xml" not in name else None, "cannot be read: .*modelDescription"),
        (2, in_description("<CoSimulation", "<ModelExchange"), "cannot be read: .*canHandleVariableCommunicationStep"),
        (2, in_description('fmiVersion="2.0"', 'fmiVersion="1.0"'), "cannot be read: |is of FMI 1.0"),
        (2, in_description('fmiVersion="2.0"', 'fmiVersion="9.0"'), "Unsupported FMI version: 9.0"),
        (2, in_description("</fmiModelDescription>", ""), "cannot be read: "),
        (
            2,
            in_description('"continuous"><Real unit="m" start="0"/>', '"discrete"><Integer start="0"/>'),
            "'front.stroke', whose type is Integer; it must be Real",
        ),
        (
            3,
            in_description("<CoSimulation ", '<CoSimulation fixedInternalStepSize="0.0015" '),
            "the step is 0.001 s, and the FMU's own one is 0.0015 s; give a step that is a whole multiple of it",
        ),
    ],
)
def test_an_fmu_that_cannot_play_here_is_refused_in_one_sentence(write, tmp_path, fmi, change, said):
    path = write(fmi=fmi)
    rewritten(tmp_path / "two_post.fmu", change)
    with pytest.raises(SpecimenError, match=said) as caught:
        load_any_rig(path)
    assert str(caught.value).startswith("specimen two_post: ")
    assert "\n" not in str(caught.value)
    assert str(tmp_path) not in str(caught.value)


def test_an_fmu_in_millimetres_is_played_in_metres(write, tmp_path, responses):
    path = write(responses=responses, start_values={"stiffness": 400.0})
    # The beam does not know: a millimetre to it is a metre, and it is a thousand times softer in N/mm.
    rewritten(tmp_path / "two_post.fmu", in_description('<BaseUnit m="1"/>', '<BaseUnit m="1" factor="0.001"/>'))
    rig = load_any_rig(path)
    given = drive(samples=100, size=1e-4)
    expected = forces(1000.0 * given, steps=1, stiffness=400.0)
    np.testing.assert_allclose(played(rig, given)[0].response, expected, rtol=1e-9, atol=1e-9)


def test_every_unit_of_a_channel_is_known_and_written_as_fmus_write_it():
    assert set(_EXPONENTS) == set(UNIT_OF.values())
    assert [_plain(unit) for unit in ("N.m", "m/s2", "m/s", "1")] == ["N*m", "m/s^2", "m/s", "1"]


def test_without_fmpy_it_says_what_to_install(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(SpecimenError, match=r"needs fmpy, which is not installed; .* pip install 'duralab\[fmu\]'"):
        load_any_rig(write())


def test_rigs_play_at_once(write):
    rig = load_any_rig(write())
    expected = played(rig, drive())[0].response.tobytes()
    found = []
    threads = [threading.Thread(target=lambda: found.append(played(rig, drive())[0].response)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [response.tobytes() for response in found] == [expected] * 2
