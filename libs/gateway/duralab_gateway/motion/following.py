"""Playback of a rig that follows commands: a controller plays a piece of a drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from duralab_gateway.motion.playback import Approach, Block, DriveChannel, DrivePlayback, RigFaultError, Use
from duralab_gateway.motion.watchdogs import when


class FollowedDrive(DrivePlayback):
    """Playback whose blocks are commands to a controller and its measurements.

    `follow` plays commands (drives, samples) and returns the measured (responses, samples), fewer only if `stopped`
    returns that the run must end; it gets `block_samples` at a time, fewer at the end.
    """

    def __init__(
        self,
        follow: Callable[[np.ndarray], np.ndarray],
        drive: np.ndarray,
        *,
        channels: Sequence[DriveChannel],
        response_names: Sequence[str],
        approach: Approach,
        sample_rate: float,
        block_samples: int,
        stopped: Callable[[], bool],
        frames: Callable[[], np.ndarray | None] = lambda: None,
    ) -> None:
        super().__init__(
            drive,
            channels=channels,
            approach=approach,
            sample_rate=sample_rate,
            responses=len(response_names),
            block_samples=block_samples,
        )
        self._follow = follow
        self._names = [channel.name for channel in channels]
        self._response_names = list(response_names)
        self._stopped = stopped
        self._frames = frames

    def cut(self, seconds: float) -> None:
        """Do nothing: the controller decides the length of a piece."""

    def frames(self, instants: Sequence[int]) -> np.ndarray | None:
        """Return the present positions of the bodies, the only ones that are known."""
        del instants
        present = self._frames()
        return None if present is None else present[None]

    def uses(self) -> list[Use]:
        """Return the peak of every drive: the use of its actuator is unknown here."""
        return [Use(name, ratio, 0.0, 0.0) for name, ratio in zip(self._names, self.peak_ratios(), strict=True)]

    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        del counted
        asked = commands[:, :-1]
        response = np.asarray(self._follow(asked.copy()), dtype=np.float64)
        self._check(response, asked.shape[1], first)
        samples = response.shape[1]
        return Block(
            first_sample=first,
            drive=asked[:, :samples],
            response=response,
            following_error=np.zeros((len(asked), samples)),
            monitored=np.empty((0, samples)),
        )

    def _check(self, response: np.ndarray, samples: int, first: int) -> None:
        rows = len(self._response_names)
        if response.ndim != 2 or len(response) != rows or response.shape[1] > samples:
            raise RigFaultError(
                f"the rig measured an array of shape {response.shape} {when(first / self._rate)}; "
                f"({rows}, {samples}) was commanded."
            )
        if response.shape[1] < samples and not self._stopped():
            raise RigFaultError(
                f"the rig measured {response.shape[1]} of {samples} samples {when(first / self._rate)}, and it "
                "was not stopped."
            )
        if not np.isfinite(response).all():
            row, sample = np.argwhere(~np.isfinite(response))[0]
            raise RigFaultError(
                f"the response of {self._response_names[row]} is {response[row, sample]} "
                f"{when((first + sample) / self._rate)}; every value must be finite."
            )
