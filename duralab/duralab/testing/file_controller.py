"""Rig controller that exchanges files, for rehearsals and tests: it plays correctly, or with injected faults."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Collection
from enum import StrEnum
from pathlib import Path

import numpy as np

from duralab.errors import LabError
from duralab_drive_files import (
    ControllerMap,
    DataType,
    Order,
    Rpc3Settings,
    TimeHistory,
    read_order,
    read_rpc3,
    resampled,
    sampled_at,
    write_rpc3,
)

_POLL_SECONDS = 0.1
_FRAME = 1024
_OFF_SECONDS = 7200.0
_MARK = np.float32(1.2345678e33)


class ControllerFault(StrEnum):
    """Faults of a controller or its operator."""

    LOST_LAST_FRAME = "lost last frame"
    SHORT_RECORDING = "recording ended too early"
    SPAN_OF_80_PERCENT = "span of 80 %"
    SWAPPED_CHANNELS = "two channels swapped"
    INVERTED_CHANNEL = "one channel inverted"
    PREVIOUS_RUN = "the previous run's file"
    OTHER_RUN = "another run played"
    DRIFTING_CLOCK = "a clock 50 ppm off"
    BROKEN_OFF = "run broken off"
    MISSING_CHANNEL = "a channel not recorded"
    NOT_FINITE = "a value that is not finite"
    DAMAGED_FILE = "a damaged file"
    HALF_WRITTEN = "a file half written at first"
    FUTURE_STAMP = "a time stamp in the future"
    OLD_FILE = "a file older than its drive"


class FileController:
    """Player of the drive files of an exchange folder on a rig; saves response files.

    If the rig refuses a drive, the controller refuses it to the lab as an operator does: by `inbox/<run>.refuse.txt`.

    Parameters
    ----------
    controller_map : ControllerMap
        Map of the served rig, with the channels, units and exchange folder.
    play : callable
        Plays a drive (drives, samples) at the map's `sample_rate`; returns responses (responses, samples).
        `lambda drive: lab.play("front_axle", drive).response.samples` plays on a rig of a lab.
    delay : float
        Samples at `sample_rate` by which commands and responses are recorded late, 0 or more.
    gain : float
        Ratio of the played and recorded command to the drive file; greater than 0.
    response_rate : float, optional
        Sample rate of the response files, in Hz; the drive file's if not given.
    data_type : DataType
        Data type of the response files.
    faults : collection of ControllerFault
        Injected faults, all in every run; `faults` may be changed between runs.
    write_seconds : float
        Duration for which a file stays half written, 0 or more, in s.
    seed : int
        Seed of the affected channels and positions.

    Raises
    ------
    ValueError
        A value is not allowed.
    """

    def __init__(
        self,
        controller_map: ControllerMap,
        play: Callable[[np.ndarray], np.ndarray],
        *,
        delay: float = 37.4,
        gain: float = 1.005,
        response_rate: float | None = None,
        data_type: DataType = DataType.SHORT_INTEGER,
        faults: Collection[ControllerFault] = (),
        write_seconds: float = 0.0,
        seed: int = 0,
    ) -> None:
        for name, value, is_allowed in (
            ("delay", delay, delay >= 0.0),
            ("gain", gain, gain > 0.0),
            ("response_rate", response_rate, response_rate is None or response_rate > 0.0),
            ("write_seconds", write_seconds, write_seconds >= 0.0),
        ):
            if not is_allowed:
                raise ValueError(f"{name} is {value:g}; it must be positive, delay and write_seconds may be 0.")
        self._map, self.folder, self._play = controller_map, controller_map.exchange, play
        self._delay, self._gain = delay, gain
        self._rate = response_rate or controller_map.controller_rate
        self._data_type = data_type
        self.faults = frozenset(faults)
        self._write_seconds = write_seconds
        self._random = np.random.default_rng(seed)
        self._before: tuple[np.ndarray, bytes] | None = None
        self._half: list[tuple[float, Path, bytes]] = []
        self._ended = threading.Event()
        self.played_runs: list[str] = []
        """Names of all played runs, in order; a run that is played twice is listed twice."""

    def step(self) -> list[str]:
        """Complete half-written files, and play each drive file that was not played yet.

        Returns
        -------
        list of str
            Names of the runs played by this call.
        """
        now, due = time.monotonic(), self._half
        self._half = [each for each in due if each[0] > now]
        for moment, path, content in due:
            if moment <= now:
                self._write(path, content)
        waiting = sorted((self.folder / "outbox").glob("*.json"))
        runs = [path.stem for path in waiting if path.stem not in self.played_runs]
        for path in waiting:
            if path.stem in runs:
                self.play_order(read_order(path))
        return runs

    def play_order(self, order: Order) -> Path:
        """Play one drive file, and save its response, or the reason of the rig's refusal.

        Parameters
        ----------
        order : Order
            Order of the file in the outbox.

        Returns
        -------
        Path
            Path of the file saved in the inbox.
        """
        self.played_runs.append(order.run)
        history = read_rpc3(self.folder / "outbox" / f"{order.run}.drv")
        samples = self._map.drives_from_controller(history)[:, : order.samples]
        asked = resampled(samples, history.sample_rate, self._map.sample_rate)
        drive = asked if ControllerFault.OTHER_RUN not in self.faults or self._before is None else self._before[0]
        drive = self._mistaken(self._gain * (self._led(drive) if order.drive_has_offset else drive))
        try:
            response = self._play(drive)
        except LabError as error:
            refusal = self.folder / "inbox" / f"{order.run}.refuse.txt"
            refusal.write_text(str(error), encoding="utf-8")
            return refusal
        recorded = np.vstack([self._commands(drive), self._map.responses_to_controller(response)])
        content = self._file(recorded, order)
        path = self.folder / "inbox" / order.response_file
        self._save(path, self._other(content))
        self._before = asked, content
        return path

    def run(self) -> None:
        """Play incoming drive files until `end`."""
        while not self._ended.wait(_POLL_SECONDS):
            self.step()

    def end(self) -> None:
        """Make `run` return."""
        self._ended.set()

    def _led(self, drive: np.ndarray) -> np.ndarray:
        """Return a drive with the controller's ramps from rest and back to rest."""
        count = round(self._map.lead_seconds * self._map.sample_rate)
        rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / count)
        return np.hstack([drive[:, :1] * rise, drive, drive[:, -1:] * rise[::-1]])

    def _mistaken(self, drive: np.ndarray) -> np.ndarray:
        """Return the drive with the injected faults; only moving channels are swapped or inverted, scaled by limits."""
        limits = np.array([[max(-each.minimum, each.maximum)] for each in self._map.drives])
        shares = drive / limits
        # A fault in a channel at rest would have no effect.
        moving = self._random.permutation(np.flatnonzero(np.ptp(shares, axis=1) > 1.0e-3))
        if ControllerFault.SWAPPED_CHANNELS in self.faults:
            shares[moving[:2]] = shares[moving[1::-1]]
        if ControllerFault.INVERTED_CHANNEL in self.faults:
            shares[moving[-1]] *= -1.0
        if ControllerFault.SPAN_OF_80_PERCENT in self.faults:
            shares *= 0.8
        if ControllerFault.BROKEN_OFF in self.faults:
            # Program stop: the command returns to zero at once, the acquisition continues.
            broken = int(self._random.uniform(0.3, 0.8) * shares.shape[1])
            way = min(round(self._map.lead_seconds * self._map.sample_rate), shares.shape[1] - broken)
            fall = np.zeros(shares.shape[1] - broken)
            fall[:way] = 0.5 + 0.5 * np.cos(np.pi * np.arange(way) / way)
            shares[:, broken:] = shares[:, broken - 1 : broken] * fall
        return shares * limits

    def _commands(self, drive: np.ndarray) -> np.ndarray:
        recorded = [bool(each.recorded_command) for each in self._map.drives]
        return self._map.drives_to_controller(drive)[recorded]

    def _file(self, recorded: np.ndarray, order: Order) -> bytes:
        """Return the response file of recorded signals, delayed and at the controller's rate."""
        rate = self._map.sample_rate
        ppm = 50.0e-6 if ControllerFault.DRIFTING_CLOCK in self.faults else 0.0
        seconds = (recorded.shape[1] - 1 + self._delay) / rate
        if ControllerFault.SHORT_RECORDING in self.faults:
            lead = 0.0 if order.drive_has_offset else order.lead_samples / order.sample_rate
            seconds -= lead + self._delay / rate + self._random.uniform(0.02, 0.5) * (seconds - 2.0 * lead)
        instants = np.arange(int(seconds * self._rate) + 1) / self._rate * (1.0 + ppm) - self._delay / rate
        kept = sampled_at(recorded, rate, instants, new_rate=self._rate)
        names, data_type = list(order.wanted_channels), self._data_type
        units = [each.controller_unit for each in self._map.drives if each.recorded_command]
        units += [each.controller_unit for each in self._map.responses]
        if ControllerFault.MISSING_CHANNEL in self.faults:
            lost = int(self._random.integers(len(names)))
            kept = np.delete(kept, lost, axis=0)
            del names[lost], units[lost]
        if ControllerFault.NOT_FINITE in self.faults:
            kept[self._random.integers(len(kept)), self._random.integers(kept.shape[1])] = _MARK
            data_type = DataType.FLOATING_POINT
        path = self.folder / "inbox" / f".{order.response_file}.part"
        settings = Rpc3Settings(data_type=data_type, points_per_frame=_FRAME, points_per_group=2 * _FRAME)
        write_rpc3(TimeHistory(tuple(names), tuple(units), self._rate, kept), path, settings)
        content = path.read_bytes()
        path.unlink()
        # The writer refuses NaN, so it is inserted afterwards, as a broken converter would do.
        content = content.replace(_MARK.tobytes(), np.float32(np.nan).tobytes())
        if ControllerFault.LOST_LAST_FRAME in self.faults:
            sample_bytes = 2 if data_type is DataType.SHORT_INTEGER else 4
            content = content[: -_FRAME * sample_bytes * len(names)]
        return content

    def _other(self, content: bytes) -> bytes:
        """Return the file content with the injected faults."""
        if ControllerFault.PREVIOUS_RUN in self.faults and self._before is not None:
            content = self._before[1]
        if ControllerFault.DAMAGED_FILE in self.faults:
            # Damage from the first half on: damage in one response alone cannot be distinguished from a measurement.
            kept = int(self._random.uniform(0.0, 0.5) * len(content))
            content = content[:kept] + self._random.bytes(int(self._random.choice([0, len(content) - kept])))
        return content

    def _save(self, path: Path, content: bytes) -> None:
        if ControllerFault.HALF_WRITTEN in self.faults:
            self._half.append((time.monotonic() + self._write_seconds, path, content))
            content = content[: int(self._random.uniform(0.0, 0.9) * len(content))]
        self._write(path, content)

    def _write(self, path: Path, content: bytes) -> None:
        partial = path.with_name(f".{path.name}.part")
        partial.write_bytes(content)
        written = partial.stat().st_mtime
        for fault, moved in ((ControllerFault.FUTURE_STAMP, _OFF_SECONDS), (ControllerFault.OLD_FILE, -_OFF_SECONDS)):
            if fault in self.faults:
                os.utime(partial, (written + moved, written + moved))
        partial.replace(path)
