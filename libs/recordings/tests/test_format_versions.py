"""A recording of format version 1 says what its own reader said of it; one of a newer format is refused."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from duralab_proto.arrays import ArrayError, from_array, from_record, samples_hash, to_array
from duralab_proto.v1 import iterator_pb2, recorder_pb2
from duralab_recordings import (
    FORMAT_VERSION,
    McapFile,
    RecordingError,
    RunSignals,
    part_metadata,
    played_epochs,
    response_in_band,
)

DATA = Path(__file__).with_name("data")
OLD = DATA / "version1.mcap"
SAID = json.loads((DATA / "version1.json").read_text())


def digest(samples: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").tobytes()).hexdigest()


@pytest.fixture(scope="module")
def file() -> McapFile:
    return McapFile(OLD)


@pytest.fixture(scope="module")
def signals(file: McapFile) -> RunSignals:
    return RunSignals(file.paths, played=played_epochs(file.messages(recorder_pb2.RunPlayed)))


def test_the_steps_of_version_1_carry_their_samples(file):
    steps = list(file.messages(iterator_pb2.IterationStep))
    assert [step.run for step in steps] == [said["run"] for said in SAID["steps"]]
    for step, said in zip(steps, SAID["steps"], strict=True):
        assert digest(from_record(step.drive)[2]) == said["drive"]
        assert digest(from_record(step.response)[2]) == said["response"]
        assert digest(from_array(step.response_in_band)) == said["response_in_band"]
        assert step.samples_hash == ""


def test_the_runs_of_version_1_are_read_from_their_blocks(signals):
    assert list(signals.runs) == SAID["runs"]
    for said in SAID["steps"]:
        window, rate = signals.whole(said["run"])
        assert (digest(window.drive), digest(window.response)) == (said["signal_drive"], said["signal_response"])
        assert rate == 200.0
    assert digest(signals.whole("version1.identify")[0].drive) == SAID["identification"]
    assert digest(signals.whole("version1.confirm01")[0].response) == SAID["confirmation"]


def write(path: Path, **part: str) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("part", part_metadata("x", number=1, previous=None, previous_sha256="") | part)
        writer.finish()
    return path


@pytest.mark.parametrize("version", [str(FORMAT_VERSION + 1), "0", "two", "99999999999999999999999"])
def test_a_newer_format_is_refused_with_its_version_and_what_to_do(tmp_path, version):
    path = write(tmp_path / "x.mcap", format_version=version)
    with pytest.raises(RecordingError) as caught:
        McapFile(path)
    assert str(caught.value) == (
        f"The recording {path} cannot be read: it has format version {version[:20]}, and this version of Duralab reads "
        f"versions 1 to {FORMAT_VERSION}; take the Duralab that recorded it, or a newer one."
    )


def test_a_newer_format_is_refused_in_a_file_without_an_end_too(tmp_path):
    path = write(tmp_path / "x.mcap", format_version="7")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(RecordingError, match="format version 7"):
        McapFile(path)


def test_the_version_of_today_and_the_one_before_are_read(tmp_path):
    assert McapFile(write(tmp_path / "x.mcap")).whole
    assert McapFile(write(tmp_path / "y.mcap", format_version="1")).whole


def test_the_hash_of_samples_does_not_depend_on_their_blocks():
    generator = np.random.default_rng(1)
    drive, response = generator.standard_normal((2, 50)), generator.standard_normal((3, 50))
    rows = b"".join(drive[:, i].tobytes() + response[:, i].tobytes() for i in range(50))
    assert samples_hash(drive, response) == hashlib.sha256(rows).hexdigest()
    assert samples_hash(drive, response) != samples_hash(drive, -response)


def test_the_response_in_the_band_is_the_target_minus_the_recorded_error():
    generator = np.random.default_rng(2)
    target, response = generator.standard_normal((2, 2, 400))
    error = (target - response).astype(np.float32)
    found = response_in_band(iterator_pb2.IterationStep(error_in_band=to_array(error)), target)
    np.testing.assert_array_less(np.abs(found - response), 6e-8 * np.abs(target - response) + 1e-15)
    old = response_in_band(iterator_pb2.IterationStep(response_in_band=to_array(response)), target)
    np.testing.assert_array_equal(old, response)
    with pytest.raises(ArrayError, match="must be float32"):
        response_in_band(iterator_pb2.IterationStep(error_in_band=to_array(target)), target)
    with pytest.raises(ArrayError, match="must be"):
        response_in_band(iterator_pb2.ConfirmationStep(error_in_band=to_array(error[:, :9])), target)
