"""What the service needs of a rig, whatever plays it: a multibody specimen, or a structure in state space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from duralab_gateway.motion import Approach, DrivePlayback, Watchdog
from rig_sim.specimen import InputChannel, Quantity, WatchdogLimits

#: Samples of every block of a playback but the last, where the engine is fast.
BLOCK_SAMPLES = 100


class Response(Protocol):
    """A measured channel."""

    @property
    def name(self) -> str:
        """Unique among the responses."""
        ...

    @property
    def label(self) -> str:
        """What it is, in words."""
        ...

    @property
    def unit(self) -> str:
        """SI unit."""
        ...

    @property
    def quantity(self) -> Quantity:
        """What it measures."""
        ...

    @property
    def range(self) -> float:
        """Largest magnitude that the sensor says, in its unit."""
        ...

    @property
    def noise_rms(self) -> float:
        """RMS of the sensor's white noise, in its unit."""
        ...


class PlayableSpecimen(Protocol):
    """What is mounted, as far as a description and the check of a drive need it."""

    @property
    def name(self) -> str:
        """Name of the rig."""
        ...

    @property
    def title(self) -> str:
        """What is mounted, in words."""
        ...

    @property
    def sample_rate(self) -> float:
        """The only one it plays, in Hz."""
        ...

    @property
    def longest_drive(self) -> float:
        """In s."""
        ...

    @property
    def approach(self) -> Approach:
        """How it gets to a drive's first sample, and back to rest."""
        ...

    @property
    def drives(self) -> Sequence[InputChannel]:
        """What can be commanded, in order."""
        ...

    @property
    def responses(self) -> Sequence[Response]:
        """What is measured, in order."""
        ...

    @property
    def watchdogs(self) -> WatchdogLimits:
        """Limits at which a run ends."""
        ...


class PlayableRig(Protocol):
    """A rig that is ready to play."""

    @property
    def specimen(self) -> PlayableSpecimen:
        """What is mounted."""
        ...

    @property
    def engine_name(self) -> str:
        """What plays."""
        ...

    @property
    def block_samples(self) -> int:
        """Samples of every block of a playback but the last."""
        ...

    @property
    def watchdogs(self) -> tuple[Watchdog, ...]:
        """What makes it ramp down and latch while it plays."""
        ...

    @property
    def static_response(self) -> np.ndarray:
        """Responses at rest, (responses,)."""
        ...

    @property
    def content_hash(self) -> str:
        """SHA-256 of everything that decides what it answers."""
        ...

    def playback(self, drive: np.ndarray, *, seed: int) -> DrivePlayback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        ...


@runtime_checkable
class KnowsItsFrf(PlayableRig, Protocol):
    """A rig whose FRF is known in closed form."""

    def sampled_frf(self, frequency: np.ndarray) -> np.ndarray:
        """Return the FRF (lines, responses, drives), complex, at frequencies (lines,) in Hz."""
        ...
