"""Events of a schedule with their drives, and the damage of one repeat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from duralab.campaign import Judgement
from duralab.data import Signals
from duralab.errors import InputError
from duralab.formats import LEFT_OUT, convert_units, read_signals
from duralab.near_files import did_you_mean
from duralab.output_files import recording_in
from duralab.recording import Recording, open_recording
from duralab_loads import channel_damage
from duralab_schedules import Event, EventLoad, Schedule


@dataclass(frozen=True, eq=False)
class PreparedEvent:
    """Event with its drive.

    Parameters
    ----------
    drive : Signals
        Drive of the event.
    target : Signals, optional
        Target response, over the whole band; None if unknown.
    response : Signals, optional
        Measured response of the best playback; None for a drive that is not from a recording.
    source : str
        Source of the drive, as text.
    campaign : str
        Campaign that made the drive; empty if none did.
    exponent : float
        Slope of the S-N line.
    """

    drive: Signals
    target: Signals | None
    response: Signals | None
    source: str
    campaign: str
    exponent: float

    @property
    def measured(self) -> Signals | None:
        """The response, or the target without a response; its damage is that of a repeat."""
        return self.response or self.target

    @property
    def load(self) -> EventLoad:
        """Load of one repeat: samples, and the damage."""
        measured = self.measured
        return EventLoad(
            samples=self.drive.samples.shape[1],
            sample_rate=self.drive.sample_rate,
            drives=len(self.drive.channels),
            # For a drive file alone the number of responses is unknown; most rigs have as many as drives.
            responses=len((measured or self.drive).channels),
            damage=None if measured is None else damage_of(measured, self.exponent),
        )


def damage_of(signals: Signals, exponent: float) -> dict[str, float]:
    """Return the damage of each channel, in its unit to the power of the exponent."""
    damage = channel_damage(signals.samples, exponents=[exponent])[:, 0]
    return dict(zip(signals.names, map(float, damage), strict=True))


def prepare_events(schedule: Schedule, *, recordings: Path | None = None) -> dict[str, PreparedEvent]:
    """Read the drives of all events of a schedule.

    Parameters
    ----------
    schedule : Schedule
        Schedule; its relative paths start in its folder.
    recordings : Path, optional
        Folder of a recorder, for events that name a recording by its id.

    Returns
    -------
    dict of str to PreparedEvent
        Events by name, in the schedule's order.

    Raises
    ------
    InputError
        A drive or target cannot be read, or a recording is of another rig or missed its target.
    """
    prepared = {}
    for name, event in schedule.events.items():
        try:
            prepared[name] = _prepared(schedule, event, recordings)
        except InputError as error:
            raise InputError(f"Event {name}: {error.message}", field=f"events.{name}") from error
    _require_one_kind(schedule, prepared)
    return prepared


def _prepared(schedule: Schedule, event: Event, recordings: Path | None) -> PreparedEvent:
    path = _find(event.drive, schedule.folder, recordings)
    exponent = float(schedule.monitoring.damage_exponent)
    if path.suffix.lower() == ".mcap":
        if event.target is not None:
            raise InputError(f"target is {event.target}; the recording {path} holds its own, so leave it out.")
        return _from_recording(open_recording(path), schedule.rig, exponent, accepted=event.missed_target_accepted)
    target = None if event.target is None else signals_in_si(schedule.folder / event.target)
    drive = signals_in_si(path)
    of_target = left_out_of(target, of=f" of {event.target}")
    note = "".join(f" ({text})" for text in (left_out_of(drive), of_target) if text)
    return PreparedEvent(drive, target, None, f"file {path.name}{note}", "", exponent)


def left_out_of(signals: Signals | None, *, of: str = "") -> str:
    """Return the part of a sentence that names the channels of a file that were left out; empty if none were."""
    sentence = "" if signals is None else signals.attributes.get(LEFT_OUT, "").rstrip(".")
    return sentence.replace("Channels", f"channels{of}", 1)


def signals_in_si(path: Path) -> Signals:
    """Return the signals of a file in SI units: the damage of different files is added."""
    signals = read_signals(path)
    try:
        return convert_units(signals)
    except InputError as error:
        raise InputError(f"{path.name}: {error.message}", field=error.field) from error


def _find(given: str, folder: Path, recordings: Path | None) -> Path:
    """Return the file of a drive given as a path, a campaign's folder, or the id of a recording."""
    path = folder / given
    candidates = [recording_in(path), *([recordings / f"{given}.mcap"] if recordings else [])]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    where = "" if recordings is None else f", and {recordings} holds no recording of that id"
    raise InputError(f"there is no drive {str(path)!r}{where}; give a drive file or a recording{did_you_mean(path)}")


def _from_recording(recording: Recording, rig: str, exponent: float, *, accepted: bool) -> PreparedEvent:
    specification, verdict, table = recording.specification, recording.verdict, recording.iterations
    if specification.rig != rig:
        raise InputError(
            f"the recording {recording.path} is of the rig {specification.rig}, and the schedule of {rig}; give a "
            f"drive that was made on {rig}."
        )
    if verdict.judgement is not Judgement.REACHED and not accepted:
        raise InputError(
            f"the recording {recording.path} missed its target ({verdict.sentence.rstrip('.')}); run the campaign on, "
            "or give missed_target_accepted: true."
        )
    if not table.numbers:
        raise InputError(f"the recording {recording.path} holds no playback; give one that has a drive.")
    best = recording.playback(table.numbers[table.best])
    target = Signals.from_message(specification.target, field="target")
    source = f"playback {table.numbers[table.best]} of {specification.id}"
    return PreparedEvent(best.drive, target, best.response, source, specification.id, exponent)


def _require_one_kind(schedule: Schedule, prepared: Mapping[str, PreparedEvent]) -> None:
    """Refuse events whose drives or responses are not those of one rig."""
    first, *others = prepared.items()
    for name, event in others:
        for what, ours, theirs in (
            ("drives", event.drive, first[1].drive),
            ("responses", event.response, first[1].response),
        ):
            if ours and theirs and (ours.names, ours.sample_rate) != (theirs.names, theirs.sample_rate):
                raise InputError(
                    f"The {what} of event {name} are {', '.join(ours.names)} at {ours.sample_rate:g} Hz and those of "
                    f"{first[0]} {', '.join(theirs.names)} at {theirs.sample_rate:g} Hz; all events of the schedule "
                    f"{schedule.name} need the channels of {schedule.rig}.",
                    field=f"events.{name}",
                )
        require_same_units(event.drive, first[1].drive, what=f"event {name}", than=first[0])
        require_same_units(event.measured, first[1].measured, what=f"event {name}", than=first[0])


def require_same_units(signals: Signals | None, others: Signals | None, *, what: str, than: str) -> None:
    """Refuse signals with a channel that has another unit in others; damage in two units cannot be added."""
    units = {} if others is None else {channel.name: channel.unit for channel in others.channels}
    for channel in () if signals is None else signals.channels:
        if (unit := units.get(channel.name, channel.unit)) != channel.unit:
            raise InputError(
                f"{channel.name} of {what} is in {channel.unit} and that of {than} in {unit}; give signals of the "
                "channels of one rig."
            )
