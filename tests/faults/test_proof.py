"""The proof that the rounds of faults rest on: it sees what is lost, doubled, out of order or other than committed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from duralab_proto.arrays import to_array
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, recorder_pb2, rig_pb2

from .keys_of_contract import NO_MESSAGES, contract_keys
from .proof import Proof, prove

BLOCKS, SAMPLES = 6, 10
WHOLE = np.arange(2.0 * BLOCKS * SAMPLES).reshape(2, -1)


def block(number: int, shift: float = 0.0) -> rig_pb2.SignalBlock:
    part = WHOLE[:, number * SAMPLES : (number + 1) * SAMPLES] + shift
    return rig_pb2.SignalBlock(
        run="a", first_sample=number * SAMPLES, drive=to_array(part), response=to_array(2.0 * part)
    )


def recorded(path: Path, numbers: list[int], *, shift: float = 0.0, steps: tuple[int, ...] = (0, 1, 2)) -> Proof:
    """Write a recording of one run with the blocks of those numbers, as they stand."""
    step = iterator_pb2.IterationStep(run="a")
    step.drive.samples.CopyFrom(to_array(WHOLE))
    step.response.samples.CopyFrom(to_array(2.0 * WHOLE))
    messages = [
        step,
        recorder_pb2.RunPlayed(run="a", epoch=5, blocks=BLOCKS),
        recorder_pb2.RecordingClosed(reason="over"),
    ]
    with (path / "x.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for number, message in [
            *((number, block(number, shift if number == 3 else 0.0)) for number in numbers),
            *zip(steps, messages, strict=True),
        ]:
            name = message.DESCRIPTOR.full_name
            schema = writer.register_schema(name, "protobuf", b"")
            topic = "signal" if isinstance(message, rig_pb2.SignalBlock) else f"step/{name}"
            channel = writer.register_channel(topic, "protobuf", schema, {"epoch": "5"})
            writer.add_message(channel, 0, message.SerializeToString(), 0, sequence=number)
        writer.finish()
    return prove(path, "x", rig="rig")


def test_a_whole_recording_has_no_findings(tmp_path: Path) -> None:
    proof = recorded(tmp_path, list(range(BLOCKS)))
    assert (proof.lost, proof.doubled, proof.reordered, proof.findings) == (0, 0, 0, [])
    assert proof.closed
    assert len(proof.playbacks) == 1


@pytest.mark.parametrize(
    ("numbers", "lost", "doubled", "reordered"),
    [
        ([0, 1, 3, 4, 5], 1, 0, 0),
        ([0, 1, 2, 3], 2, 0, 0),
        ([], 6, 0, 0),
        ([0, 1, 2, 3, 3, 4, 5], 0, 1, 0),
        ([0, 2, 1, 3, 4, 5], 0, 0, 1),
    ],
    ids=["in the middle", "the tail", "all", "twice", "late"],
)
def test_what_is_missing_doubled_or_late_is_counted(
    tmp_path: Path, numbers: list[int], lost: int, doubled: int, reordered: int
) -> None:
    proof = recorded(tmp_path, numbers)
    assert (proof.lost, proof.doubled, proof.reordered) == (lost, doubled, reordered)


def test_samples_other_than_those_committed_and_a_missing_step_are_found(tmp_path: Path) -> None:
    (finding,) = recorded(tmp_path, list(range(BLOCKS)), shift=1e-9).findings
    assert "sample 30" in finding
    (finding,) = recorded(tmp_path, list(range(BLOCKS)), steps=(0, 2, 3)).findings
    assert "[0, 2, 3]" in finding


def test_a_recording_that_is_not_there_is_found(tmp_path: Path) -> None:
    assert prove(tmp_path, "x", rig="rig").findings == ["x: there is no file"]


def test_every_key_of_the_contract_is_sent_malformed_messages() -> None:
    named = {key.name for key in contract_keys(Keys())}
    every = {name for name in vars(Keys) if not name.startswith("_") and callable(getattr(Keys, name))}
    assert named == every - NO_MESSAGES
