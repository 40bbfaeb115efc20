"""Rig with a known linear plant: its FRF is exact, and its noise repeats with the seed of the run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy import signal

from duralab_gateway import Run
from duralab_proto.arrays import to_array
from duralab_proto.v1 import array_pb2, rig_pb2

Filter = tuple[Sequence[float], Sequence[float]]
"""Numerator and denominator in z^-1 of one response to one drive."""

_PLANT: tuple[tuple[Filter, ...], ...] = (
    (([2.0e4, 1.0e4], [1.0, -1.7, 0.8]), ([0.0, 5.0e3], [1.0, -0.5])),
    (([1.0e4], [1.0, -1.2, 0.6]), ([3.0e4, -2.0e4], [1.0, -1.6, 0.75])),
)


class LinearRig:
    """Rig for tests: linear filters between drives and responses, with a static part and white noise.

    Parameters
    ----------
    name : str
        Name of the rig on the bus.
    plant : sequence of sequence of Filter
        One row per response, one filter per drive; two drives in m and two responses in N if not given.
    drives, responses : sequence of array_pb2.Channel
        Channels of the plant; if not given, named after their kind and number.
    sample_rate : float
        Sample rate in Hz.
    static : sequence of float
        Responses at rest, in their units; zero if not given.
    noise_rms : float or sequence of float
        RMS of the white noise of all responses, or of each, in their units.
    block_samples : int
        Number of samples of a signal block.
    longest_drive : float
        Longest drive in s.

    Raises
    ------
    ValueError
        The plant, the channels and the static part do not fit together.
    """

    def __init__(
        self,
        name: str = "linear",
        *,
        plant: Sequence[Sequence[Filter]] = _PLANT,
        drives: Sequence[array_pb2.Channel] | None = None,
        responses: Sequence[array_pb2.Channel] | None = None,
        sample_rate: float = 1000.0,
        static: Sequence[float] | None = None,
        noise_rms: float | Sequence[float] = 0.0,
        block_samples: int = 100,
        longest_drive: float = 600.0,
    ) -> None:
        columns = {len(row) for row in plant}
        if len(columns) != 1 or 0 in columns:
            raise ValueError(f"plant has rows of {sorted(columns)} filters; each response needs one for every drive.")
        self.name = name
        self.sample_rate = sample_rate
        self.plant = tuple(tuple(row) for row in plant)
        self.drives = list(_channels("stroke", "m", 0.1, columns.pop()) if drives is None else drives)
        self.responses = list(_channels("force", "N", 1.0e6, len(plant)) if responses is None else responses)
        shape = (len(self.plant), len(self.plant[0]))
        if (len(self.responses), len(self.drives)) != shape:
            raise ValueError(
                f"the plant has {shape[0]} responses to {shape[1]} drives; {len(self.responses)} response and "
                f"{len(self.drives)} drive channels are given."
            )
        self.static = np.zeros(shape[0]) if static is None else np.asarray(static, dtype=float)
        if self.static.shape != shape[:1]:
            raise ValueError(f"static has the shape {self.static.shape}; it must be {shape[:1]}.")
        self.noise_rms = np.broadcast_to(np.asarray(noise_rms, dtype=float), shape[:1])
        self._block_samples, self._longest_drive = block_samples, longest_drive
        self._run: Run | None = None
        self._noise = np.random.default_rng(0)
        self._states: list[list[np.ndarray]] = []

    def describe(self) -> rig_pb2.RigDescription:
        """Return the description of the rig."""
        return rig_pb2.RigDescription(
            rig=self.name,
            specimen="a linear plant",
            engine="filter",
            version="1",
            sample_rate=self.sample_rate,
            drives=self.drives,
            responses=self.responses,
            longest_drive_seconds=self._longest_drive,
            static_response=to_array(self.static),
            block_samples=self._block_samples,
            simulated=True,
        )

    def play(self, commands: np.ndarray, run: Run) -> np.ndarray:
        """Return the responses to a piece of a run; each run begins at rest.

        Parameters
        ----------
        commands : (drives, samples)
            Piece of the drive, each row in its channel's unit; it continues the previous piece.
        run : Run
            Present run; its seed is that of the noise.

        Returns
        -------
        ndarray, (responses, samples)
            Each row in its channel's unit.
        """
        if run is not self._run:
            self._begin(run)
        response = np.zeros((len(self.responses), commands.shape[1]))
        for row, (filters, states) in enumerate(zip(self.plant, self._states, strict=True)):
            for column, (numerator, denominator) in enumerate(filters):
                part, states[column] = signal.lfilter(numerator, denominator, commands[column], zi=states[column])
                response[row] += part
        # One row per sample, so that the noise does not depend on the pieces of the run.
        noise = self._noise.standard_normal((commands.shape[1], len(response))).T
        return response + self.static[:, None] + self.noise_rms[:, None] * noise

    def stop(self, reason: str) -> None:
        """Do nothing: no piece waits.

        Parameters
        ----------
        reason : str
            Reason of the stop.
        """

    def reset(self) -> None:
        """Do nothing: every run begins at rest."""

    def respond(self, drive: np.ndarray, *, seed: int | None = None) -> np.ndarray:
        """Return the response that a run with this drive measures; without noise if no seed is given.

        Parameters
        ----------
        drive : (drives, samples)
            Drive, each row in its channel's unit; it begins with a step if its first sample is not zero.
        seed : int, optional
            Seed of the run.

        Returns
        -------
        ndarray, (responses, samples)
            Each row in its channel's unit, static part included.
        """
        response = np.stack(
            [
                np.sum([signal.lfilter(*one, row) for one, row in zip(filters, drive, strict=True)], axis=0)
                for filters in self.plant
            ]
        )
        response += self.static[:, None]
        if seed is not None:
            noise = np.random.default_rng(seed).standard_normal((drive.shape[1], len(response))).T
            response += self.noise_rms[:, None] * noise
        return response

    def sampled_frf(self, frequency: np.ndarray) -> np.ndarray:
        """Return the exact FRF.

        Parameters
        ----------
        frequency : (lines,)
            Frequencies in Hz, 0 to half the sample rate.

        Returns
        -------
        ndarray, (lines, responses, drives)
            Complex FRF, in units of response over drive.
        """
        delay = np.exp(-2j * np.pi * np.asarray(frequency) / self.sample_rate)
        rows = [[polyval(delay, above) / polyval(delay, below) for above, below in filters] for filters in self.plant]
        return np.ascontiguousarray(np.asarray(rows).transpose(2, 0, 1))

    def _begin(self, run: Run) -> None:
        self._run = run
        self._noise = np.random.default_rng(run.seed)
        self._states = [
            [np.zeros(max(len(numerator), len(denominator)) - 1) for numerator, denominator in filters]
            for filters in self.plant
        ]


def _channels(what: str, unit: str, limit: float, count: int) -> list[array_pb2.Channel]:
    kind = array_pb2.CHANNEL_KIND_DISPLACEMENT if unit == "m" else array_pb2.CHANNEL_KIND_FORCE
    return [
        array_pb2.Channel(
            name=f"{what}_{number}", unit=unit, kind=kind, minimum=-limit, maximum=limit, holds_static=unit == "m"
        )
        for number in range(1, count + 1)
    ]
