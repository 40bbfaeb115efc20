"""Start of a campaign from recordings and files: a model, a first drive, playbacks of other campaigns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from duralab.campaign import Campaign, EditStep, StartFrom, Stretch, Taper, TaperLevel
from duralab.data import Rig, Signals
from duralab.errors import InputError, LabError
from duralab.formats import LEFT_OUT
from duralab.lab.campaign_result import CampaignResult
from duralab.lab.campaign_running import recording_file
from duralab.lab.client import LabClient, require_one
from duralab.lab.fetching import Part, fetch, wait_until_closed
from duralab.lab.playing import read_drive_file
from duralab.lab.recordings_folder import RecordingsPlace
from duralab.near_files import did_you_mean
from duralab.recording import Recording, open_recording
from duralab_bus import FaultError
from duralab_proto.v1 import iterator_pb2
from duralab_recordings import part_path

_SECTION: Final = "-section"
"""Suffix of the name of a campaign on a section of the target."""
_TAPER_SECONDS: Final = 0.25
"""Taper at both ends of a section: an abrupt begin or end would require an impact."""


def fill_known(
    specification: iterator_pb2.CampaignSpec,
    start: StartFrom,
    *,
    ask: LabClient,
    rig: Rig,
    place: RecordingsPlace,
    folder: Path,
) -> str:
    """Add the start of a campaign to its specification; raises InputError if a source is missing or does not fit.

    `rig`: Rig of the campaign. `place`: Place of the lab's recordings. `folder`: Base of relative paths.
    Returns: Sentence that names the channels of the drive file that are not read; empty without such channels.
    """
    known, left_out = specification.known, ""
    if start.model is not None:
        with _recording(start.model, ask=ask, folder=folder, field="start_from.model") as recording:
            model = recording.model_message
            if model is None:
                raise InputError(
                    f"start_from.model is {start.model!r}, a recording without a model; name that of a campaign whose "
                    "rig was identified.",
                    field="start_from.model",
                )
            known.model.CopyFrom(model)
            known.model_source, known.model_time = recording.specification.id, recording.begun
        known.largest_model_age = start.model_age or 0.0
        specification.estimator.CopyFrom(model.estimator)
        specification.excitation.CopyFrom(model.excitation)
        specification.excitation.seed = 0
    if start.drive is not None:
        drive, response = _first_drive(start.drive, ask=ask, rig=rig, folder=folder)
        put_first_drive(specification, drive, response, source=start.drive)
        left_out = drive.attributes.get(LEFT_OUT, "")
    for given in start.learn_from:
        path, id = recording_file(given), given
        if path is not None:
            recording = open_recording(folder / path)
            id = recording.specification.id
            if place.file(id) is None:
                place.copy_in(recording)
        else:
            require_one(ask.key("start_from.learn_from", ask.bus.keys.recording, id))
        known.learn_from.append(id)
    return left_out


def put_first_drive(
    specification: iterator_pb2.CampaignSpec,
    drive: Signals,
    response: Signals | None,
    *,
    source: str,
    first_second: float = 0.0,
) -> None:
    """Put a first drive into a specification, padded with zeros before `first_second` and after the drive's end."""
    samples, length = len_of_target(specification), drive.samples.shape[1]
    first = round(first_second * drive.sample_rate)
    if first + length > samples:
        raise InputError(
            f"start_from.drive is {source!r}, which lasts {drive.duration:g} s; the target lasts "
            f"{samples / drive.sample_rate:g} s: cut the drive, or take one that is no longer.",
            field="start_from.drive",
        )
    into = specification.known.first_drive
    into.source = source
    for message, signals in ((into.drive, drive), (into.response, response)):
        if signals is not None:
            padded = np.pad(signals.samples, ((0, 0), (first, samples - first - length)))
            message.CopyFrom(replace(signals, samples=padded).to_message())


def len_of_target(specification: iterator_pb2.CampaignSpec) -> int:
    """Return the number of samples of a specification's target."""
    return int(specification.target.samples.shape[1])


def section_campaign(plan: Campaign) -> Campaign | None:
    """Return the campaign on a section of the target that precedes a campaign; None if the plan has no section."""
    start = plan.start_from
    if start is None or start.section is None:
        return None
    section = start.section
    steps = (
        EditStep(cut=Stretch(**{"from": section.start, "to": section.end})),
        EditStep(taper=Taper(seconds=_TAPER_SECONDS, to=TaperLevel.MEAN)),
    )
    target = plan.target.model_copy(update={"edit": (*plan.target.edit, *steps)})
    changes = {
        "name": f"{plan.name[: 60 - len(_SECTION)]}{_SECTION}",
        "target": target,
        "stop": plan.stop.model_copy(update={"iterations": section.iterations}),
        "start_from": start.model_copy(update={"section": None}),
        "confirmations": 0,
    }
    return plan.model_copy(update=changes).read_from(folder=plan.folder, text="")


def after_section(plan: Campaign, section: CampaignResult) -> Campaign:
    """Return a campaign that continues with the whole target from the model and the playbacks of its section."""
    before = plan.start_from or StartFrom()
    model, learned = str(section.recording_path.resolve()), (*before.learn_from, section.specification.id)
    start = before.model_copy(update={"model": model, "model_age": None, "learn_from": learned})
    return plan.model_copy(update={"start_from": start})


def best_playback(recording: Recording, *, name: str, field: str) -> tuple[Signals, Signals]:
    """Return drive and response of the best playback, or of the last if the campaign did not end."""
    numbers = recording.iterations.numbers
    if not numbers:
        raise InputError(
            f"{field} is {name!r}, a recording without a playback; name that of a campaign that played.", field=field
        )
    best = recording.status.best_iteration if recording.status is not None else 0
    playback = recording.playback(best or numbers[-1])
    return playback.drive, playback.response


def _first_drive(given: str, *, ask: LabClient, rig: Rig, folder: Path) -> tuple[Signals, Signals | None]:
    field = "start_from.drive"
    path = folder / given
    if path.suffix != ".mcap" and path.is_file():
        return read_drive_file(path, rig), None
    if path.suffix not in ("", ".mcap") and not path.is_file():
        raise InputError(
            f"{field} is {given!r}, and there is no file {str(path)!r}; give a drive file, a recording or the id of one"
            f"{did_you_mean(path)}",
            field=field,
        )
    with _recording(given, ask=ask, folder=folder, field=field) as recording:
        return best_playback(recording, name=given, field=field)


def holds_model(id: str, *, ask: LabClient) -> bool:
    """Return whether the lab's recorder has a recording of this id that is closed and holds a model."""
    try:
        with _recording(id, ask=ask, folder=Path(), field="start_from.model") as recording:
            return recording.model is not None
    except LabError:
        # Of a campaign that ended early perhaps not even the beginning was recorded.
        return False


@contextmanager
def _recording(given: str, *, ask: LabClient, folder: Path, field: str) -> Iterator[Recording]:
    """Open a recording by its path, or by its id from the lab's recorder."""
    path = recording_file(given)
    if path is not None:
        yield open_recording(folder / path)
        return
    require_one(ask.key(field, ask.bus.keys.recording, given))
    with TemporaryDirectory(prefix="duralab-") as temporary:
        first = Path(temporary) / "recording.mcap"
        try:
            information = wait_until_closed(ask.bus, given)
            for number, file in enumerate(information.files, start=1):
                to = part_path(first, number)
                fetch(ask.bus, given, part=Part.RECORDING, path=to, number=number, file_hash=file.file_hash)
        except FaultError as fault:
            raise ask.explained(fault) from fault
        yield open_recording(first)
