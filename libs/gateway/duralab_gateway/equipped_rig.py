"""Playback rig with the sensors and calculated channels of its table: described, watched and played."""

from __future__ import annotations

from datetime import date

import numpy as np

from duralab_bus import ConfigError
from duralab_gateway.channels import ChannelTable, weighted_sum
from duralab_gateway.motion import DrivePlayback, Level, Source, Watchdog
from duralab_gateway.rig import KnowsItsFrf, PlaybackRig, Run, StepwiseRig
from duralab_proto.v1 import rig_pb2


class EquippedRig(PlaybackRig):
    """Rig with the sensors and calculated channels of a table; raises `ConfigError` if the table does not fit."""

    def __init__(self, rig: PlaybackRig, channels: ChannelTable) -> None:
        self._rig = rig
        given = rig.describe()
        try:
            self._description = channels.complete(given, today=date.today())
        except ValueError as error:
            raise ConfigError(f"channels.{given.rig}: {error}") from error
        self._rows = channels.rows(self._description)
        self.approach = rig.approach
        self.watchdogs = (*rig.watchdogs, *_levels(self._description))

    @property
    def knowing(self) -> object:
        """Source of the FRF: the rig, or with calculated responses this object, which adds theirs."""
        knowing = self._rig.rig if isinstance(self._rig, StepwiseRig) else self._rig
        return _CalculatedFrf(knowing, self._rows) if self._rows and isinstance(knowing, KnowsItsFrf) else knowing

    def describe(self) -> rig_pb2.RigDescription:
        """Return its description, with sensors and calculated responses."""
        return self._description

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive, with the calculated responses."""
        playback = self._rig.playback(drive, run)
        if self._rows:
            playback.calculate(self._calculated)
        return playback

    def stop(self, reason: str) -> None:
        """Forward to the rig."""
        self._rig.stop(reason)

    def reset(self) -> None:
        """Forward to the rig."""
        self._rig.reset()

    def _calculated(self, response: np.ndarray) -> np.ndarray:
        return np.stack([weighted_sum(factors, response) for factors in self._rows])


class _CalculatedFrf:
    """FRF of a rig with calculated responses."""

    def __init__(self, rig: KnowsItsFrf, rows: list[dict[int, float]]) -> None:
        self._rig, self._rows = rig, rows

    def sampled_frf(self, frequency: np.ndarray) -> np.ndarray:
        """Return the FRF (lines, responses, drives), calculated responses last."""
        measured = self._rig.sampled_frf(frequency)
        rows = [weighted_sum(factors, measured.transpose(1, 0, 2)) for factors in self._rows]
        return np.ascontiguousarray(np.concatenate([measured, np.stack(rows, axis=1)], axis=1))


def _levels(description: rig_pb2.RigDescription) -> list[Watchdog]:
    """Return the levels of the sensors as limits of the magnitude."""
    return [
        Watchdog(Source.RESPONSE, channel.name, row, channel.unit, -limit, limit, level)
        for row, channel in enumerate(description.responses)
        for level, limit in (
            (Level.WARNING, channel.sensor.warning_level),
            (Level.ABORT, channel.sensor.abort_level),
        )
        if limit > 0.0
    ]
