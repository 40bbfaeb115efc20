"""A recording of a campaign, read from its MCAP file piece by piece."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from google.protobuf.message import Message

from duralab.errors import InputError
from duralab.iteration_table import IterationTable
from duralab.mcap_reading import McapFile
from duralab.recording_content import ActuatorUse, Model, Playback, actuator_use, playback_of
from duralab.signal_windows import SignalWindows
from duralab.signals import Signals, channels_of
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, recorder_pb2, rig_pb2

if TYPE_CHECKING:
    import xarray

    from duralab.recording_arrays import Direction

MessageT = TypeVar("MessageT", bound=Message)


class Recording:
    """A recording on disk; nothing of it stays in memory but what is asked for.

    Parameters
    ----------
    path : str or Path
        The .mcap file.

    Raises
    ------
    InputError
        There is no such file, or it is no recording of a campaign.
    """

    def __init__(self, path: str | Path) -> None:
        if not str(path):
            raise InputError("There is no recording ''; give the path of an .mcap file.")
        self.path = Path(path)
        self._file = McapFile(self.path)

    @property
    def files(self) -> tuple[Path, ...]:
        """Its files, in order: the one that was opened, and those in which it goes on."""
        return tuple(self._file.paths)

    @property
    def whole(self) -> bool:
        """False where the file was never finished; what was written is read all the same."""
        return self._file.whole

    def messages(self, kind: type[MessageT]) -> Iterator[MessageT]:
        """Yield all messages of one type, e.g. `duralab_proto.v1.rig_pb2.SignalBlock`, one in memory at a time.

        Parameters
        ----------
        kind : type
            Of the contract.

        Yields
        ------
        Message
            In the order in which they were written.
        """
        return self._file.messages(kind)

    def _first(self, kind: type[MessageT], what: str) -> MessageT:
        message = next(self.messages(kind), None)
        if message is None:
            raise InputError(f"The recording {self.path} holds no {what}; it ended before one was committed.")
        return message

    @contextmanager
    def _decoding(self) -> Iterator[None]:
        try:
            yield
        except ArrayError as error:
            raise InputError(f"The recording {self.path} holds what its contract does not allow: {error}") from error

    @cached_property
    def specification(self) -> iterator_pb2.CampaignSpec:
        """What was asked for, as it was committed."""
        return self._first(iterator_pb2.CampaignSpec, "campaign")

    @cached_property
    def rig(self) -> rig_pb2.RigDescription:
        """The rig as it described itself."""
        return self._first(rig_pb2.RigDescription, "rig description")

    @cached_property
    def status(self) -> iterator_pb2.CampaignStatus | None:
        """How the campaign ended; None where it did not."""
        last = deque(self.messages(iterator_pb2.CampaignStatus), maxlen=1)
        return last.pop() if last else None

    @cached_property
    def closed(self) -> recorder_pb2.RecordingClosed | None:
        """The last step; None where the recording was not closed."""
        return next(self.messages(recorder_pb2.RecordingClosed), None)

    @cached_property
    def target(self) -> Signals:
        """The target as it is judged: in the control band."""
        message = self._first(iterator_pb2.TargetInBand, "target")
        given = self.specification.target
        with self._decoding():
            samples = from_array(message.samples, field="samples", shape=(len(given.channels), None))
        return Signals(channels_of(given.channels), given.sample_rate, samples)

    @cached_property
    def model(self) -> Model | None:
        """The identified rig; None where the campaign did not come so far."""
        message = next(self.messages(identifier_pb2.Model), None)
        with self._decoding():
            return Model.from_message(message) if message is not None else None

    @cached_property
    def _iterations(self) -> list[tuple[iterator_pb2.IterationMetrics, tuple[ActuatorUse, ...], tuple[str, ...]]]:
        return [
            (step.metrics, actuator_use(step.actuators), tuple(step.remarks))
            for step in self.messages(iterator_pb2.IterationStep)
        ]

    @cached_property
    def iterations(self) -> IterationTable:
        """The figures of every playback."""
        return IterationTable.from_messages([metrics for metrics, _, _ in self._iterations])

    @cached_property
    def actuators(self) -> list[tuple[ActuatorUse, ...]]:
        """How the actuators were used, for each playback."""
        return [use for _, use, _ in self._iterations]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was said of each playback: limits that its drive would have passed, targets out of reach."""
        return tuple(remark for _, _, remarks in self._iterations for remark in remarks)

    def playback(self, number: int) -> Playback:
        """Read one playback.

        Parameters
        ----------
        number : int
            From 1 to the number of playbacks.

        Returns
        -------
        Playback
            Drive, response and what was judged.

        Raises
        ------
        InputError
            There is no such playback.
        """
        for step in self.messages(iterator_pb2.IterationStep):
            if step.iteration == number:
                with self._decoding():
                    return playback_of(step)
        numbers = ", ".join(str(n) for n in self.iterations.numbers) or "none"
        raise InputError(f"{self.path} holds no playback {number}; it holds {numbers}.")

    def signal(self, run: str) -> tuple[Signals, Signals]:
        """Put the blocks of one run on the rig together again, e.g. of the identification.

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
            No block of that run was recorded, or a block is missing: the last one too, where the run was broken off.
        """
        epoch, sample_rate, end = -1, 0.0, -1
        blocks: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for number, block in self._file.with_epochs(rig_pb2.SignalBlock):
            if block.run != run or number < epoch:
                continue
            if number > epoch:
                # The run was repeated: the newest counts, as for `responses`.
                epoch, blocks, end = number, {}, -1
            with self._decoding():
                drive = from_array(block.drive, field="drive", shape=(len(self.rig.drives), None))
                response = from_array(block.response, field="response", shape=(len(self.rig.responses), None))
            blocks[block.first_sample], sample_rate = (drive, response), block.sample_rate
            end = block.first_sample if block.last else end
        if not blocks:
            raise InputError(
                f"{self.path} holds no signals of a run {run!r}; it holds {', '.join(self.runs) or 'none'}."
            )
        drives, responses = zip(*self._in_order(blocks, run), strict=True)
        if end != max(blocks):
            reached = max(blocks) + drives[-1].shape[1]
            repair = "" if self.whole else "start the recorder on its folder, which repairs it, then "
            raise InputError(
                f"{self.path} holds the run {run!r} up to sample {reached - 1} ({reached / sample_rate:g} s) only and "
                f"not its last block; {repair}read what is there with `responses({run!r})` and `drives({run!r})`."
            )
        return (
            Signals(channels_of(self.rig.drives), sample_rate, np.concatenate(drives, axis=1)),
            Signals(channels_of(self.rig.responses), sample_rate, np.concatenate(responses, axis=1)),
        )

    def _in_order(
        self, blocks: dict[int, tuple[np.ndarray, np.ndarray]], run: str
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield blocks by their first sample: one that was lost on the way and fetched later is written late."""
        reached = 0
        for first in sorted(blocks):
            if first > reached:
                raise InputError(f"{self.path} lacks the samples {reached} to {first - 1} of the run {run!r}.")
            if first < reached:
                raise InputError(f"{self.path} holds the samples {first} to {reached - 1} of the run {run!r} twice.")
            yield blocks[first]
            reached += blocks[first][0].shape[1]

    def drives(self, *runs: str) -> xarray.Dataset:
        """Return what was commanded in runs; see `responses`."""
        from duralab.recording_arrays import Direction

        return self._signals(runs, Direction.DRIVE)

    def responses(self, *runs: str) -> xarray.Dataset:
        """Return what was measured in runs; samples are read when they are used, and only those that are.

        Parameters
        ----------
        *runs : str
            Names of runs of one length; the iterations where none is given. One run alone has no dimension `run`; one
            that was broken off is as long as what there is of it.

        Returns
        -------
        xarray.Dataset
            A variable for each channel over `run` and `time` in s, with its unit in the attribute `units`; the
            coordinate `iteration` is 0 for a run that is none. `responses().sel(time=slice(20, 30))` reads ten seconds.

        Raises
        ------
        InputError
            No signals of such a run, runs of different lengths, or a file that is damaged or was never finished.
        """
        from duralab.recording_arrays import Direction

        return self._signals(runs, Direction.RESPONSE)

    def _signals(self, runs: Sequence[str], direction: Direction) -> xarray.Dataset:
        from duralab.recording_arrays import Direction, signal_dataset

        if not self.whole:
            raise InputError(
                f"{self.path} was never finished and has no index; start the recorder on its folder, which repairs it, "
                "or read whole runs with `signal`."
            )
        channels = self.rig.drives if direction is Direction.DRIVE else self.rig.responses
        return signal_dataset(
            self._windows,
            channels_of(channels),
            runs or tuple(self._iteration_runs),
            direction=direction,
            iterations=self._iteration_runs,
            flat=len(runs) == 1,
        )

    @cached_property
    def _windows(self) -> SignalWindows:
        return SignalWindows(self._file.paths)

    @cached_property
    def _iteration_runs(self) -> dict[str, int]:
        return {step.run: step.iteration for step in self.messages(iterator_pb2.IterationStep)}

    @cached_property
    def runs(self) -> tuple[str, ...]:
        """Names of the playbacks on the rig that were planned, in order."""
        return tuple(message.run for message in self.messages(recorder_pb2.RunPlanned))

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """Named sets of texts that the recorder wrote."""
        return self._file.metadata()

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file, hexadecimal."""
        with self.path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"Recording({str(self.path)!r})"

    def __str__(self) -> str:
        """Return it as a table."""
        from duralab.showing.campaigns import recording_text

        return recording_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.campaigns import recording_html

        return recording_html(self)


def open_recording(path: str | Path) -> Recording:
    """Open a recording, as `duralab.open` too; see `Recording`.

    Parameters
    ----------
    path : str or Path
        The .mcap file.

    Returns
    -------
    Recording
        Read as it is asked for.
    """
    return Recording(path)
