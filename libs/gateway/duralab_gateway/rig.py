"""Interface of a rig to a gateway: four methods of a real one, or the playbacks of a simulated one."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Protocol, runtime_checkable

import numpy as np

from duralab_bus import FaultError
from duralab_gateway.motion import Approach, DrivePlayback, FollowedDrive, Source, Watchdog
from duralab_proto.v1 import rig_pb2


class Phase(Enum):
    """Part of a run."""

    SETTLING = "settling"
    PLAYING = "playing"
    RAMPING_DOWN = "ramping down"


class Run:
    """Present run, as its rig sees it.

    Parameters
    ----------
    name : str
        Name of the run, unique on the rig.
    seed : int
        Seed of the random parts of the response, 0 or more.
    real_time : bool
        Whether the drive is played in real time. A real rig always does.
    report : callable
        Sends a sentence of progress to the commander, and the played share of the drive if it is known.
    stopping : callable
        Given a time in s, waits for a stop for at most that time; returns whether one came.
    waiting : callable
        Publishes in the rig's state what the run waits for.
    """

    def __init__(
        self,
        name: str,
        *,
        seed: int = 0,
        real_time: bool = False,
        report: Callable[[str, float | None], None] = lambda _sentence, _fraction: None,
        stopping: Callable[[float], bool] = lambda _seconds: False,
        waiting: Callable[[str], None] = lambda _sentence: None,
    ) -> None:
        self.name = name
        self.seed = seed
        self.real_time = real_time
        self.phase = Phase.SETTLING
        self._report = report
        self._stopping = stopping
        self._waiting = waiting

    def report(self, sentence: str, fraction: float | None = None) -> None:
        """Report the rig's activity, e.g. "waiting for the operator to press start".

        Parameters
        ----------
        sentence : str
            Present activity.
        fraction : float, optional
            Played share of the drive, 0 to 1; the gateway's value if omitted.
        """
        self._report(sentence, None if fraction is None else min(max(fraction, 0.0), 1.0))

    def wait_for(self, sentence: str) -> None:
        """Publish in the rig's state and to the commander what the run waits for; call again while it waits.

        Parameters
        ----------
        sentence : str
            Awaited object, e.g. "the response file run_3.rsp".
        """
        self._waiting(sentence)
        self.report(f"waiting for {sentence}")

    @property
    def stopped(self) -> bool:
        """Whether `play` must end early: the rig was stopped, or no client waits for the run any more.

        False during the ramp down, which is played to its end.
        """
        return self.wait_for_stop(0.0)

    def wait_for_stop(self, seconds: float) -> bool:
        """Wait for at most this time, in s; return True early if the run must end."""
        return self.phase is not Phase.RAMPING_DOWN and self._stopping(seconds)


class RunEndedError(FaultError):
    """A run that ended before anything moved: its commander gets the fault, and the rig does not latch."""


class Rig(Protocol):
    """Rig with a controller: the interface that a gateway needs to put it on the bus.

    The gateway checks every drive, plays one at a time, ramps to the first sample and back to zero, publishes the
    measurements, monitors its limits, latches and resets. It calls `play` on one thread at a time, and `stop` on any.
    """

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig; called once.

        Returns
        -------
        rig_pb2.RigDescription
            Names, channels, units and hard limits, sample rate in Hz, longest drive in s. A `watchdog` of a response is
            monitored. If omitted, `static_response` is zero, `block_samples` a tenth of a second, and `content_hash`
            that of the description. `publishes_after_run` makes the gateway give the whole drive to one call of `play`;
            `cannot_be_stopped` makes a run continue to its end. Campaigns wait for a person before their first playback
            unless it states `simulated`.
        """
        ...

    def play(self, commands: np.ndarray, run: Run) -> np.ndarray:
        """Play a piece of a run and return the measurements; the call takes as long as the motion.

        Parameters
        ----------
        commands : (drives, samples)
            Commands, each row in its drive's unit, in the order of the description. The first piece continues from
            zero, each other from the last value of the piece before. At most `block_samples`, or all at once, see
            `describe`.
        run : Run
            Present run: its seed, its reports, and whether it is stopped.

        Returns
        -------
        ndarray, (responses, samples)
            Responses, each row in its unit; fewer samples only if `run.stopped`.

        Raises
        ------
        RigFaultError
            If the rig cannot continue; one sentence. The gateway latches, and no ramp down is played.
        """
        ...

    def stop(self, reason: str) -> None:
        """End a waiting `play` soon; called on every latch, also at rest, from any thread.

        The gateway plays the ramp down to zero afterwards: do not remove the pressure here. The safety of people
        depends on the controller's emergency stop and never on this method.

        Parameters
        ----------
        reason : str
            Reason as text.
        """
        ...

    def reset(self) -> None:
        """Make the rig ready again after a latch; called at rest.

        Raises
        ------
        RigFaultError
            If it must not be reset now; one sentence with the reason. The latch stays.
        """
        ...


class PlaybackRig(Protocol):
    """Rig that makes its own playback of a drive, as simulated ones do; `StepwiseRig` makes one of any `Rig`.

    `approach`: Ramps to the first sample and back. `watchdogs`: Limits at which it ramps down and latches while it
    plays.
    """

    approach: Approach
    watchdogs: tuple[Watchdog, ...]

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig; called once."""
        ...

    def playback(self, drive: np.ndarray, run: Run) -> DrivePlayback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        ...

    def stop(self, reason: str) -> None:
        """Handle a latch; see `Rig.stop`."""

    def reset(self) -> None:
        """Make ready again; see `Rig.reset`."""


@runtime_checkable
class KnowsItsFrf(Protocol):
    """A rig whose FRF is known in closed form."""

    def sampled_frf(self, frequency: np.ndarray) -> np.ndarray:
        """Return the FRF (lines, responses, drives), complex, at frequencies (lines,) in Hz."""
        ...


@runtime_checkable
class ShowsFrames(Protocol):
    """Rig with the positions of its bodies."""

    def frames(self) -> np.ndarray:
        """Return frames (bodies, 12), in the order of the description: rotation row by row, then the origin in m."""
        ...


@runtime_checkable
class KnowsMore(Protocol):
    """Playback that adds to its result, after its blocks are published."""

    def complete(self, result: rig_pb2.PlayResult) -> None:
        """Add the data that only this playback has."""
        ...


class StepwiseRig:
    """Playback rig made of a `Rig` and its description: plays drives piece by piece, with ramps in and out."""

    def __init__(self, rig: Rig, description: rig_pb2.RigDescription, *, approach: Approach) -> None:
        self.rig = rig
        self.approach = approach
        self._description = description
        self.watchdogs = tuple(
            Watchdog(Source.RESPONSE, channel.name, row, channel.unit, -channel.watchdog, channel.watchdog)
            for row, channel in enumerate(description.responses)
            if channel.watchdog > 0.0
        )
        self._frames = rig.frames if isinstance(rig, ShowsFrames) else lambda: None

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig."""
        return self._description

    def playback(self, drive: np.ndarray, run: Run) -> FollowedDrive:
        """Return a playback of a checked drive."""
        description = self._description
        return FollowedDrive(
            lambda commands: self.rig.play(commands, run),
            drive,
            channels=description.drives,
            response_names=[channel.name for channel in description.responses],
            approach=self.approach,
            sample_rate=description.sample_rate,
            # A rig that measures at the end gets each ramp and the drive in one piece.
            block_samples=_WHOLE if description.publishes_after_run else description.block_samples,
            stopped=lambda: run.stopped,
            frames=self._frames,
        )

    def stop(self, reason: str) -> None:
        """Forward to the rig."""
        self.rig.stop(reason)

    def reset(self) -> None:
        """Forward to the rig."""
        self.rig.reset()


#: Number of samples above that of any drive.
_WHOLE = 2**40
