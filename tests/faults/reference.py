"""The campaign that is disturbed, and what it gives when nothing disturbs it."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import duralab
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2

from .lab_under_fault import RIG, LabUnderFault

NAME = "undisturbed"


@dataclass(frozen=True)
class Reference:
    """A campaign's specification, the bytes of every playback, and how long it takes here."""

    specification: iterator_pb2.CampaignSpec
    playbacks: tuple[str, ...]
    seconds: float
    recording: Path


def playback_hash(step: iterator_pb2.IterationStep) -> str:
    """Return the SHA-256 of the samples, which the step names or carries."""
    if not step.HasField("response"):
        return step.samples_hash
    return samples_hash(from_array(step.drive.samples), from_array(step.response.samples))


def samples_hash(drive: np.ndarray, response: np.ndarray) -> str:
    """Return the SHA-256 of a run's samples, worked out as the contract says and by nothing of ours."""
    return hashlib.sha256(np.vstack([drive, response]).T.astype("<f8").tobytes()).hexdigest()


def playback_hashes(steps: Iterable[iterator_pb2.IterationStep]) -> tuple[str, ...]:
    return tuple(playback_hash(step) for step in steps)


def campaign_document(iterations: int) -> dict[str, Any]:
    """The shipped demo with a target of 10 s, and a first model that is coarse enough to leave work for iterations."""
    shipped = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"
    document: dict[str, Any] = yaml.safe_load(shipped.read_text())
    document["name"] = NAME
    document["rig"] = RIG
    document["excitation"]["rms"] = dict(zip(document["excitation"]["rms"], [0.004, 0.003, 0.001] * 2, strict=True))
    document["target"]["road"].update(duration=10.0, potholes={"count": 1, "depth": [0.02, 0.03], "length": [0.4, 0.8]})
    document["excitation"]["duration"] = 40.0
    document["estimator"]["block_samples"] = 1024
    document["stop"]["iterations"] = iterations
    return document


def _note(moments: list[float], progress: duralab.RunProgress) -> None:
    if progress.iterations is not None or "specification" in progress.activity or moments:
        moments.append(time.monotonic())


def make_reference(folder: Path, *, iterations: int) -> Reference:
    """Run the campaign in a lab that nothing disturbs, twice: the second time tells how long it takes."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "campaign.yaml"
    file.write_text(yaml.safe_dump(campaign_document(iterations)))
    with LabUnderFault(folder / "lab") as lab, duralab.connect(lab.endpoint, out=folder) as script:
        first = script.run(file)
        specification = first.recording.specification
        begun: list[float] = []
        second = script.run(file, on_progress=lambda progress: _note(begun, progress))
        seconds = begun[-1] - begun[0]
    playbacks = [playback_hashes(run.recording.messages(iterator_pb2.IterationStep)) for run in (first, second)]
    assert playbacks[0] == playbacks[1]
    assert len(playbacks[0]) == iterations
    return Reference(
        specification=specification,
        playbacks=playbacks[0],
        seconds=seconds,
        recording=first.recording_path,
    )
