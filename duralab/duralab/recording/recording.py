"""Recording of a campaign, read piece by piece from its MCAP file."""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Iterator, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from google.protobuf.message import Message

from duralab.campaign import Verdict, judge
from duralab.data import (
    READ_FILE,
    ActuatorUse,
    Decided,
    IterationTable,
    Model,
    Playback,
    PreTest,
    Proposal,
    RecordedTarget,
    Signals,
    actuator_use,
    channels_of,
    iterations_html,
    level_of,
    playback_of,
    response_note,
    target_note,
)
from duralab.errors import InputError
from duralab.output_files import recording_in
from duralab.recording.files import RecordingFiles, SignalWindows, input_errors
from duralab_proto.arrays import from_array
from duralab_proto.decisions import decisions_in_force, revised_specification
from duralab_proto.v1 import identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from duralab_recordings import (
    check_samples,
    index_of,
    played_epochs,
    response_in_band,
    target_of,
    unreadable,
    within_contract,
)

if TYPE_CHECKING:
    import numpy as np
    import xarray

    from duralab.recording.arrays import Direction

MessageT = TypeVar("MessageT", bound=Message)


class Recording:
    """Recording on disk; only requested parts are read into memory.

    Parameters
    ----------
    path : str or Path
        Path of the .mcap file, or of the folder of a campaign with its recording.mcap.

    Raises
    ------
    InputError
        `path` is not a path, the file does not exist, or it is not the recording of a campaign.
    """

    def __init__(self, path: str | Path) -> None:
        if not isinstance(path, str | os.PathLike):
            raise InputError(f"The recording is {path!r}; give the path of an .mcap file, a text or a pathlib.Path.")
        if not str(path):
            raise InputError("There is no recording ''; give the path of an .mcap file.")
        self.path = recording_in(Path(path))
        self._file = RecordingFiles(self.path)

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the recording, in order: the opened one, and its parts."""
        return tuple(self._file.paths)

    @property
    def begun(self) -> int:
        """Time of the first stored step, in nanoseconds since 1970 UTC; 0 if the file has no index."""
        statistics = index_of(self.path).statistics if self.whole else None
        return 0 if statistics is None else statistics.message_start_time

    @property
    def whole(self) -> bool:
        """Whether all files are finished; unfinished files are readable too.

        A file that was repaired after its recorder was killed is finished; `closed` and `open_end` show whether the
        recording ends there.
        """
        return self._file.whole

    @cached_property
    def open_end(self) -> str:
        """Reason why the recording may continue in a missing file; empty if it was closed or a file is unfinished."""
        if self.closed is not None or not self.whole:
            return ""
        return self._file.open_end()

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield all messages of one type, e.g. `duralab_proto.v1.rig_pb2.SignalBlock`, one in memory at a time.

        Parameters
        ----------
        kind : type
            Message type of the contract.

        Yields
        ------
        Message
            Messages in the order of writing.
        """
        return self._file.messages(kind)

    @cached_property
    def is_endurance(self) -> bool:
        """Whether the recording is of an endurance test, which `EnduranceRecording` reads."""
        return next(self.messages(sequencer_pb2.EnduranceVolume), None) is not None

    def _first(self, kind: type[MessageT], what: str) -> MessageT:
        message = next(self.messages(kind), None)
        if message is None:
            if next(self.messages(iterator_pb2.PreTest), None) is not None:
                raise InputError(
                    f"The recording {self.path} is that of a pre-test and holds no {what}; "
                    "`open_recording(path).pre_test` has what it found."
                )
            if self.is_endurance:
                raise InputError(
                    f"The recording {self.path} is that of an endurance test and holds no {what}; `duralab report` "
                    "shows it."
                )
            raise InputError(
                f"The recording {self.path} holds no {what}; it ended before one was committed, so give another."
            )
        return message

    @cached_property
    def specification(self) -> iterator_pb2.CampaignSpec:
        """Committed specification."""
        return self._first(iterator_pb2.CampaignSpec, "campaign")

    @cached_property
    def rig(self) -> rig_pb2.RigDescription:
        """Description of the rig."""
        return self._first(rig_pb2.RigDescription, "rig description")

    @cached_property
    def status(self) -> iterator_pb2.CampaignStatus | None:
        """Final status of the campaign; None if it has not ended."""
        last = deque(self.messages(iterator_pb2.CampaignStatus), maxlen=1)
        return last.pop() if last else None

    @cached_property
    def pre_test(self) -> PreTest | None:
        """Result of the pre-test; None if the recording is not of a completed pre-test."""
        message = next(self.messages(iterator_pb2.PreTest), None)
        with input_errors(), within_contract(self.path):
            return PreTest.from_message(message) if message is not None else None

    @cached_property
    def closed(self) -> recorder_pb2.RecordingClosed | None:
        """Last step; None if the recording was not closed."""
        return next(self.messages(recorder_pb2.RecordingClosed), None)

    @cached_property
    def target(self) -> RecordedTarget:
        """Target in the control band, as used for judging; `target(in_band=...)` has the layout of the responses.

        If a decision changed the band, it is the target in the last band.
        `responses()` are as measured. Compare `target(in_band=True)` with `responses(in_band=True)`, or use `error()`,
        which is their difference.
        """
        given = self.specification.target
        return RecordedTarget(
            channels_of(given.channels),
            given.sample_rate,
            self._targets[-1],
            note=target_note(self.specification_in_use, in_band=True),
            dataset=self._target_dataset,
        )

    @cached_property
    def _targets(self) -> list[np.ndarray]:
        """Target in each control band of the campaign, shape (responses, samples)."""
        self._first(iterator_pb2.TargetInBand, "target")
        shape = (len(self.specification.target.channels), None)
        with input_errors(), within_contract(self.path):
            return [
                from_array(message.samples, field="samples", shape=shape)
                for message in self.messages(iterator_pb2.TargetInBand)
            ]

    @cached_property
    def decisions(self) -> tuple[Decided, ...]:
        """Decisions at the campaign's hold points, in order."""
        return tuple(Decided.from_message(message) for message in self.decision_messages)

    @cached_property
    def decision_messages(self) -> list[iterator_pb2.Decision]:
        """Decisions as messages of the contract, with the changed settings."""
        return decisions_in_force(self.messages(iterator_pb2.Decision), self.messages(iterator_pb2.Proposal))

    @cached_property
    def specification_in_use(self) -> iterator_pb2.CampaignSpec:
        """Specification with the changes made at hold points."""
        return self._specifications[-1]

    @cached_property
    def _specifications(self) -> list[iterator_pb2.CampaignSpec]:
        """Specification in each control band of the campaign, with the changes up to the next band."""
        found = [self.specification]
        for decision in self.decision_messages:
            revised = revised_specification(found[-1], decision)
            found[len(found) - (not decision.HasField("control_band")) :] = [revised]
        return found

    @property
    def proposals(self) -> Iterator[Proposal]:
        """Proposals at the campaign's hold points, each with its drive; read one by one."""
        for message in self.messages(iterator_pb2.Proposal):
            with input_errors(), within_contract(self.path):
                yield Proposal.from_message(message)

    def _target_dataset(self, in_band: bool) -> xarray.Dataset:
        from duralab.recording.arrays import target_dataset

        if _true_or_false(in_band):
            signals = self.target
        else:
            with input_errors(), within_contract(self.path):
                signals = Signals.from_message(self.specification.target, field="target")
        channels = channels_of(self.rig.responses)
        return target_dataset(signals, channels, target_note(self.specification_in_use, in_band=in_band))

    @cached_property
    def model(self) -> Model | None:
        """Model of the rig; None if the campaign ended before its identification."""
        message = self.model_message
        with input_errors(), within_contract(self.path):
            return Model.from_message(message) if message is not None else None

    @cached_property
    def model_message(self) -> identifier_pb2.Model | None:
        """Last model of the identification, which the iteration started from, as recorded; None if there is none."""
        last = deque(self.messages(identifier_pb2.Model), maxlen=1)
        return last[0] if last else None

    @cached_property
    def _iterations(self) -> list[tuple[iterator_pb2.IterationMetrics, tuple[ActuatorUse, ...], tuple[str, ...]]]:
        return [
            (step.metrics, actuator_use(step.actuators), tuple(step.remarks))
            for step in self.messages(iterator_pb2.IterationStep)
        ]

    @cached_property
    def iterations(self) -> IterationTable:
        """Numbers of every playback."""
        return IterationTable.from_messages(
            [metrics for metrics, _, _ in self._iterations],
            confirmations=[
                step.metrics for step in self.messages(iterator_pb2.ConfirmationStep) if step.HasField("metrics")
            ],
            status=self.status,
        )

    @cached_property
    def actuators(self) -> list[tuple[ActuatorUse, ...]]:
        """Use of the actuators in each playback."""
        return [use for _, use, _ in self._iterations]

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict whether the target was reached."""
        return judge(self.iterations, specification=self.specification, status=self.status, open_end=self.open_end)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on each playback: limits that its drive would have exceeded, unreachable targets."""
        return tuple(remark for _, _, remarks in self._iterations for remark in remarks)

    def playback(self, number: int) -> Playback:
        """Read one playback.

        Parameters
        ----------
        number : int
            Number of the playback, from 1.

        Returns
        -------
        Playback
            Drive, response and judged response.

        Raises
        ------
        InputError
            There is no such playback, or its samples are missing or do not match their hash.
        """
        for step in self.messages(iterator_pb2.IterationStep):
            if step.iteration == number:
                drive, response = self._samples_of(step)
                with input_errors(), within_contract(self.path):
                    in_band = response_in_band(step, target_of(step, self._targets))
                specification = self._specifications[min(step.judged_target, len(self._specifications) - 1)]
                return playback_of(step, specification, drive=drive, response=response, in_band=in_band)
        numbers = ", ".join(str(n) for n in self.iterations.numbers) or "none"
        raise InputError(f"{self.path} holds no playback {number}; it holds {numbers}.")

    def _samples_of(self, step: iterator_pb2.IterationStep) -> tuple[Signals, Signals]:
        """Return drive and response of a playback: from its run, or from the step if it contains them."""
        if not step.HasField("response"):
            return self._whole_run(step.run, samples_hash=step.samples_hash)
        with input_errors(), within_contract(self.path):
            drive = Signals.from_message(step.drive, field="drive")
            return drive, Signals.from_message(step.response, field="response")

    def signal(self, run: str) -> tuple[Signals, Signals]:
        """Join the blocks of one run on the rig, e.g. of the identification.

        For a run that was repeated after a fault, the repeat that was played to its end counts, as for `responses`; if
        there is none, the one that was written last.

        Parameters
        ----------
        run : str
            Name of the run; `runs` lists them.

        Returns
        -------
        drive, response : Signals

        Raises
        ------
        InputError
            `run` is not a string, no block of that run was recorded, or a block is missing, e.g. the last one of an
            interrupted run.
        """
        require_run_name(run, example="signal('demo.i01')")
        return self._whole_run(run)

    def _whole_run(self, run: str, *, samples_hash: str = "") -> tuple[Signals, Signals]:
        """Read a whole run, and compare its samples with the hash if one is given."""
        with input_errors():
            window, sample_rate = self._windows.whole(run, finished=self.whole)
            if samples_hash:
                check_samples(window, samples_hash, path=self.path, run=run)
        rows, wanted = (len(window.drive), len(window.response)), (len(self.rig.drives), len(self.rig.responses))
        if rows != wanted:
            raise InputError(
                f"The recording {self.path} holds the run {run!r} with {rows[0]} drives and {rows[1]} responses; its "
                f"rig has {wanted[0]} and {wanted[1]}."
            )
        return (
            Signals(channels_of(self.rig.drives), sample_rate, window.drive.copy()),
            Signals(channels_of(self.rig.responses), sample_rate, window.response.copy()),
        )

    def drives(self, *runs: str) -> xarray.Dataset:
        """Return the drives of runs; see `responses`."""
        from duralab.recording.arrays import Direction

        return self._signals(runs, Direction.DRIVE)

    def responses(self, *runs: str, in_band: bool = False) -> xarray.Dataset:
        """Return the measured responses of runs; only the used samples are read, at their first use.

        Parameters
        ----------
        *runs : str
            Names of runs of one length, e.g. `responses("demo.i01", "demo.i02")` or `responses(*names)`. Without names:
            the iterations, except those that a resumed campaign took over, whose signals are in the recording of its
            parent, `specification.parent`. A single run has no dimension `run`; an interrupted run is as long as its
            samples.
        in_band : bool
            True for the responses in the form used for judging: in the control band, without their static part, divided
            by the level of their playback. They exist for iterations (all if no run is given) and confirmations.

        Returns
        -------
        xarray.Dataset
            A variable for each channel over `run` and `time` in s, with its unit in the attribute `units`; the
            coordinate `iteration` is 0 for a run that is not an iteration, and `level` NaN for one that was not judged.
            `responses().sel(time=slice(20, 30))` reads ten seconds. The coordinate `band` and the attributes
            `quantity`, `band`, `lowest_frequency`, `highest_frequency`, `static_part` and `level` describe the signals;
            a difference with signals of another band raises InputError.
            Changes of the dataset in place do not affect later calls.

        Raises
        ------
        InputError
            A run is not a string or has no signals, no iteration has signals, the runs differ in length, a file is
            damaged or unfinished, or, in band, a run was not judged.
        """
        from duralab.recording.arrays import Direction

        if _true_or_false(in_band):
            return self._judged(runs, quantity="response")
        return self._signals(runs, Direction.RESPONSE)

    def error(self, *runs: str) -> xarray.Dataset:
        """Return target minus response of playbacks, in the form used for judging, in the control band.

        Parameters
        ----------
        *runs : str
            Names of iterations or confirmations; all iterations if none is given.

        Returns
        -------
        xarray.Dataset
            Equal to `target(in_band=True) - responses(*runs, in_band=True)`, with attributes. A channel's RMS over
            `time`, divided by that of its target, is the `relative_rms_error` of `iterations`. The error of a playback
            at partial level is divided by its level.

        Raises
        ------
        InputError
            A run is not a string or was not judged, or a file is damaged.
        """
        return self._judged(runs, quantity="error")

    def _judged(self, runs: Sequence[str], *, quantity: str) -> xarray.Dataset:
        from duralab.recording.arrays import Direction, signal_dataset
        from duralab.recording.judged_windows import JudgedWindows

        for run in runs:
            require_run_name(run, example=f"{quantity}('demo.i01')")
        self._require_one_band(runs)
        windows = JudgedWindows(
            self._file,
            targets=self._targets,
            sample_rate=self.specification.target.sample_rate,
            levels=self._levels,
            errors=quantity == "error",
        )
        return signal_dataset(
            windows,
            channels_of(self.rig.responses),
            runs or tuple(self._iteration_runs),
            direction=Direction.RESPONSE,
            iterations=self._iteration_runs,
            levels=self._levels,
            flat=len(runs) == 1,
            note=response_note(self.specification_in_use, in_band=True, quantity=quantity),
        )

    def _require_one_band(self, runs: Sequence[str]) -> None:
        """Refuse runs of several control bands, as in a campaign whose band was changed by a decision."""
        steps = (*self.messages(iterator_pb2.IterationStep), *self.messages(iterator_pb2.ConfirmationStep))
        last = len(self._targets) - 1
        others = [step.run for step in steps if (step.run in runs or not runs) and step.judged_target != last]
        if others:
            raise InputError(
                f"{', '.join(others)} of {self.path} were judged in another control band, which a decision changed; "
                "ask for the runs after it, or read `playback(number).response_in_band`.",
                field="runs",
            )

    def _signals(self, runs: Sequence[str], direction: Direction) -> xarray.Dataset:
        from duralab.recording.arrays import Direction, signal_dataset

        for run in runs:
            require_run_name(run, example=f"{direction.value}s('demo.i01', 'demo.i02') or {direction.value}s(*names)")
        if not self.whole:
            raise InputError(
                f"{self.path} was never finished and has no index; continue with it (`duralab resume`), start the "
                "recorder on its folder again, which repairs it, or read whole runs with `signal`."
            )
        is_drive = direction is Direction.DRIVE
        return signal_dataset(
            self._windows,
            channels_of(self.rig.drives if is_drive else self.rig.responses),
            runs or self._iterations_played_here(),
            direction=direction,
            iterations=self._iteration_runs,
            levels=self._levels,
            flat=len(runs) == 1,
            note=None if is_drive else response_note(self.specification, in_band=False),
        )

    @cached_property
    def _windows(self) -> SignalWindows:
        return SignalWindows(self._file.paths, played=self._played_epochs)

    @cached_property
    def _played_epochs(self) -> dict[str, int]:
        # The process may have been killed between a step and the record that its run was played.
        steps = (*self.messages(iterator_pb2.IterationStep), *self.messages(iterator_pb2.ConfirmationStep))
        named = {step.run: step.signal_epoch for step in steps if step.samples_hash}
        return named | played_epochs(self.messages(recorder_pb2.RunPlayed))

    @cached_property
    def _iteration_steps(self) -> dict[str, tuple[int, float]]:
        return {step.run: (step.iteration, level_of(step)) for step in self.messages(iterator_pb2.IterationStep)}

    @cached_property
    def _iteration_runs(self) -> dict[str, int]:
        return {run: number for run, (number, _) in self._iteration_steps.items()}

    @cached_property
    def _levels(self) -> dict[str, float]:
        """Levels of the judged runs; the best drive is confirmed at full level."""
        confirmations = {step.run: 1.0 for step in self.messages(iterator_pb2.ConfirmationStep)}
        return {run: level for run, (_, level) in self._iteration_steps.items()} | confirmations

    def _iterations_played_here(self) -> tuple[str, ...]:
        """Return the runs of the iterations with signals here; for those taken over only the steps are here."""
        specification = self.specification
        found = tuple(run for run, number in self._iteration_runs.items() if number > specification.parent_iteration)
        if self._iteration_runs and not found:
            raise InputError(
                f"{self.path} holds no signals of its iterations, which were all taken over; open the recording of its "
                f"parent {specification.parent!r} for them."
            )
        return found

    @cached_property
    def runs(self) -> tuple[str, ...]:
        """Names of the planned runs, in order."""
        return tuple(message.run for message in self.messages(recorder_pb2.RunPlanned))

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Named metadata that the recorder wrote."""
        return self._file.metadata()

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of all its files, one after the other, hexadecimal; raises InputError if one no longer exists."""
        found = hashlib.sha256()
        for path in self.files:
            try:
                with path.open("rb") as stream:
                    # The digest of the stream goes on where that of the file before ended.
                    hashlib.file_digest(stream, lambda: found)
            except OSError as error:
                raise InputError(unreadable(path, error).message) from error
        return found.hexdigest()

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"Recording({str(self.path)!r})"

    def __str__(self) -> str:
        """Return a table as text."""
        return recording_text(self)

    def _repr_html_(self) -> str:

        return recording_html(self)


def require_run_name(run: object, *, example: str) -> None:
    """Refuse a value that is not the name of a run, e.g. a list; raises InputError with an example."""
    if not isinstance(run, str):
        raise InputError(f"A run is {run!r}; give each name as a separate string, e.g. {example}.")


def _true_or_false(in_band: object) -> bool:
    if not isinstance(in_band, bool):
        raise InputError(f"in_band is {in_band!r}; give True or False.", field="in_band")
    return in_band


def open_recording(path: str | Path) -> Recording:
    """Open a recording; also available as `duralab.open`. See `Recording`.

    Parameters
    ----------
    path : str or Path
        The .mcap file, or the folder of a campaign with its recording.mcap.

    Returns
    -------
    Recording
        Recording, read on demand.
    """
    return Recording(path)


def _target_lines(recording: Recording) -> str:
    """Return the steps of making the target as text, a line for each."""
    steps = recording.specification.target_steps
    first = 0 if steps and steps[0].name == READ_FILE else 1
    return "".join(f"target, step {number}, {step.name}: {step.finding}\n" for number, step in enumerate(steps, first))


def _recording_title(recording: Recording) -> str:
    whole = f"; {recording.open_end}".rstrip("; .") if recording.whole else "; never finished"
    specification = recording.specification
    return f"{specification.id} on {recording.rig.rig}, {len(recording.runs)} runs, {recording.path}{whole}"


def recording_text(recording: Recording) -> str:
    """Return a summary of a recording as text."""
    return f"{_recording_title(recording)}\n{_target_lines(recording)}{recording.iterations}"


def recording_html(recording: Recording) -> str:
    """Return a summary of a recording as HTML."""
    lines = "".join(f"<p>{escape(line)}</p>" for line in _target_lines(recording).splitlines())
    return f"<p>{escape(_recording_title(recording))}</p>{lines}{iterations_html(recording.iterations)}"
