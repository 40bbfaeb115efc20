"""The controller for rehearsals: what it saves is the drive as stated, or wrong in the stated way and in no other."""

import time
from contextlib import closing

import numpy as np
import pytest

from duralab.errors import LabError
from duralab.testing import ControllerFault, FileController
from duralab_drive_files import DataType, DriveFileError, Inbox, Outbox, read_controller_map, read_rpc3

RATE, LEAD, DELAY, GAIN = 500.0, 500, 37.4, 1.005
MAP = """
rig: beam
sample_rate: 500
controller_rate: 512
lead: 1.0
drives:
  lift: {channel: Lift, kind: displacement, unit: mm, sign: -1, minimum: -100, maximum: 100, recorded_command: Lift Cmd}
  push: {channel: Push, kind: force, unit: kN, offset: 1.0, minimum: -19, maximum: 21, recorded_command: Push Cmd}
responses:
  load: {channel: Load, kind: force, unit: kN, offset: 0.2, minimum: -200, maximum: 200}
"""
LIMITS = np.array([[0.1], [2.0e4]])
TONES = np.array([[3.0], [11.0]])


def drive_at(seconds):
    """Return two tones in a Hann window, in the units of the lab; zero outside their 4 s."""
    inside = (seconds >= 0.0) & (seconds <= 4.0)
    return 0.5 * LIMITS * np.sin(np.pi * seconds / 4.0) ** 2 * np.sin(2.0 * np.pi * TONES * seconds) * inside


DRIVE = drive_at(np.arange(2001) / RATE)


@pytest.fixture
def exchange(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(MAP)
    with closing(Outbox(read_controller_map(path))) as exchange:
        yield exchange


def controller_of(exchange, *faults, play=lambda drive: 3.0 * drive[1:], **more):
    more = {"data_type": DataType.FLOATING_POINT, **more}
    return FileController(exchange.map, play, faults=faults, **more)


def played(exchange, *faults, **more):
    """Return the response file of one run, and the instants of its samples on the drive's clock."""
    exchange.put("one", DRIVE)
    controller_of(exchange, *faults, **more).step()
    history = read_rpc3(exchange.inbox / "one.rsp")
    seconds = (np.arange(history.samples.shape[1]) / history.sample_rate) - (LEAD + DELAY) / RATE
    return history, seconds


def in_lab(history):
    """Return commands and response in the units of the lab, from the names and units of the map alone."""
    rows = dict(zip(history.labels, history.samples, strict=True))
    lift, push, load = rows["Lift Cmd"], rows["Push Cmd"], rows["Load"]
    return np.stack([-1.0e-3 * lift, 1.0e3 * (push - 1.0)]), 1.0e3 * (load - 0.2)


def test_commands_and_response_are_late_and_too_large_as_stated_at_another_rate(exchange):
    history, seconds = played(exchange, response_rate=2048.0)
    assert history.sample_rate == 2048.0
    commands, load = in_lab(history)
    expected = GAIN * drive_at(seconds)
    # What the drive file's 16 bits leave: half a step of the full scale.
    np.testing.assert_allclose(commands / LIMITS, expected / LIMITS, atol=5.0e-5)
    np.testing.assert_allclose(load / 6.0e4, expected[1] / 2.0e4, atol=5.0e-5)


def test_sixteen_bits_leave_half_a_step(exchange):
    history, seconds = played(exchange, data_type=DataType.SHORT_INTEGER)
    commands, _ = in_lab(history)
    assert history.attributes["DATA_TYPE"] == "SHORT_INTEGER"
    np.testing.assert_allclose(commands / LIMITS, GAIN * drive_at(seconds) / LIMITS, atol=1.0e-4)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (ControllerFault.SPAN_OF_80_PERCENT, lambda drive, _: 0.8 * drive),
        (ControllerFault.SWAPPED_CHANNELS, lambda drive, _: (drive / LIMITS)[::-1] * LIMITS),
        (
            ControllerFault.DRIFTING_CLOCK,
            lambda _, seconds: drive_at(seconds + 50.0e-6 * (seconds + (LEAD + DELAY) / RATE)),
        ),
    ],
)
def test_a_fault_of_the_run_is_in_the_recorded_commands(exchange, fault, expected):
    history, seconds = played(exchange, fault)
    commands, _ = in_lab(history)
    wanted = GAIN * expected(drive_at(seconds), seconds)
    np.testing.assert_allclose(commands / LIMITS, wanted / LIMITS, atol=1.0e-4)


def test_one_channel_is_inverted_and_the_other_is_not(exchange):
    history, seconds = played(exchange, ControllerFault.INVERTED_CHANNEL)
    commands, _ = in_lab(history)
    signs = np.sign((commands * drive_at(seconds)).sum(axis=1))
    assert sorted(signs) == [-1.0, 1.0]


def test_a_run_that_breaks_off_goes_to_zero_and_is_recorded_to_the_end(exchange):
    history, seconds = played(exchange, ControllerFault.BROKEN_OFF)
    commands, _ = in_lab(history)
    difference = np.abs(commands - GAIN * drive_at(seconds)) / LIMITS
    broken = seconds[np.argmax(difference.max(axis=0) > 1.0e-3)]
    assert 0.25 * 6.0 < broken + 1.0 < 0.85 * 6.0
    assert np.abs(commands[:, -200:] / LIMITS).max() < 1.0e-3
    assert seconds[-1] > 4.9


def test_a_short_recording_ends_before_the_drive(exchange):
    _, seconds = played(exchange, ControllerFault.SHORT_RECORDING)
    assert seconds[-1] < 4.0


def test_a_channel_is_missing(exchange):
    history, _ = played(exchange, ControllerFault.MISSING_CHANNEL)
    assert len(history.labels) == 2


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (ControllerFault.LOST_LAST_FRAME, "bytes"),
        (ControllerFault.NOT_FINITE, "nan"),
        (ControllerFault.DAMAGED_FILE, "."),
        (ControllerFault.HALF_WRITTEN, "."),
    ],
)
def test_a_file_cannot_be_read(exchange, fault, reason):
    with pytest.raises(DriveFileError, match=reason):
        played(exchange, fault)


@pytest.mark.parametrize(("fault", "sign"), [(ControllerFault.FUTURE_STAMP, 1.0), (ControllerFault.OLD_FILE, -1.0)])
def test_a_time_stamp_is_hours_off(exchange, fault, sign):
    played(exchange, fault)
    assert sign * ((exchange.inbox / "one.rsp").stat().st_mtime - time.time()) > 3600.0


@pytest.fixture
def after_a_run(exchange):
    """A controller that has played a run, whose files are in `outbox/done`."""
    controller = controller_of(exchange)
    order = exchange.put("one", DRIVE)
    controller.step()
    exchange.end(order, "answered")
    return controller


def test_the_file_of_the_run_before_comes_again(exchange, after_a_run):
    after_a_run.faults = frozenset([ControllerFault.PREVIOUS_RUN])
    exchange.put("two", 0.5 * DRIVE[:, ::-1])
    after_a_run.step()
    assert (exchange.inbox / "two.rsp").read_bytes() == (exchange.done / "one.rsp").read_bytes()


def test_the_drive_of_the_run_before_is_played_again(exchange, after_a_run):
    after_a_run.faults = frozenset([ControllerFault.OTHER_RUN])
    exchange.put("two", 0.5 * DRIVE[:, ::-1])
    after_a_run.step()
    before, again = (in_lab(read_rpc3(path)) for path in (exchange.done / "one.rsp", exchange.inbox / "two.rsp"))
    np.testing.assert_array_equal(again[0], before[0])
    assert after_a_run.played_runs == ["one", "two"]


def test_a_half_written_file_is_completed_and_nothing_is_played_twice(exchange):
    exchange.put("one", DRIVE)
    controller = controller_of(exchange, ControllerFault.HALF_WRITTEN)
    assert controller.step() == ["one"]
    size = (exchange.inbox / "one.rsp").stat().st_size
    assert controller.step() == []
    assert (exchange.inbox / "one.rsp").stat().st_size > size
    commands, _ = in_lab(read_rpc3(exchange.inbox / "one.rsp"))
    assert np.abs(commands / LIMITS).max() == pytest.approx(0.5 * GAIN, rel=0.01)
    assert controller.played_runs == ["one"]


def test_what_the_rig_refuses_is_refused_to_the_lab(exchange):
    def refuse(_drive):
        raise LabError("the specimen is not clamped")

    order = exchange.put("one", DRIVE)
    controller_of(exchange, play=refuse).step()
    assert Inbox(exchange).refusal_by_person(order) == "the specimen is not clamped"
    assert not (exchange.inbox / "one.rsp").exists()


def test_the_same_seed_makes_the_same_bytes(exchange):
    exchange.put("one", DRIVE)
    contents = []
    for _ in range(2):
        controller_of(exchange, ControllerFault.BROKEN_OFF, seed=3).step()
        contents.append((exchange.inbox / "one.rsp").read_bytes())
    assert contents[0] == contents[1]


@pytest.mark.parametrize(
    ("name", "value"), [("delay", -1.0), ("gain", 0.0), ("response_rate", 0.0), ("write_seconds", -1.0)]
)
def test_a_value_that_is_not_allowed_is_refused(exchange, name, value):
    with pytest.raises(ValueError, match=name):
        controller_of(exchange, **{name: value})
