"""Common part of playbacks of simulated rigs: the sensors, with their noise and their faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from duralab_gateway.motion import DrivePlayback
from rig_sim.playing.faults import DriftingGain, Fault, NoisySensor, SensorFault, StuckSensor
from rig_sim.specimen import RigSpecimen

#: Number of samples in every block of a playback except the last, for a fast engine.
BLOCK_SAMPLES = 100


class SimulatedPlayback(DrivePlayback):
    """A playback with noisy and possibly faulty sensors."""

    def __init__(
        self, specimen: RigSpecimen, drive: np.ndarray, *, seed: int, faults: Sequence[Fault], block_samples: int
    ) -> None:
        super().__init__(
            drive,
            channels=specimen.drives,
            approach=specimen.approach,
            sample_rate=specimen.sample_rate,
            responses=len(specimen.responses),
            block_samples=block_samples,
        )
        self._noise = np.random.default_rng(seed)
        # Memory for the numbers of a block, which is used again.
        self._normal = np.empty((0, len(specimen.responses)))
        self._noise_rms = np.array([channel.noise_rms for channel in specimen.responses])
        channels = [channel.name for channel in specimen.responses]
        self._sensors = FaultySensors(faults, channels=channels, sample_rate=specimen.sample_rate, seed=seed)

    def _sensed(self, first_sample: int, response: np.ndarray) -> np.ndarray:
        """Return the sensor readings of a response (responses, samples)."""
        # One row of noise per sample: the same numbers for any division of the record into blocks.
        samples = response.shape[1]
        if len(self._normal) < samples:
            self._normal = np.empty((samples, len(response)))
        noise = self._noise.standard_normal(out=self._normal[:samples]).T
        sensed = np.multiply(noise, self._noise_rms[:, None], order="C")
        sensed += response
        return self._sensors.inject_faults(first_sample, sensed)


class FaultySensors:
    """Sensors with faults, applied block by block; the same bytes for any division of the record into blocks."""

    def __init__(self, faults: Sequence[Fault], *, channels: Sequence[str], sample_rate: float, seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, SensorFault)]
        self._rows = [list(channels).index(fault.channel) for fault in self._faults]
        self._rate = sample_rate
        self._stuck: dict[int, float] = {}
        self._noise = {
            index: np.random.default_rng(np.random.SeedSequence([seed, index, fault.seed]))
            for index, fault in enumerate(self._faults)
            if isinstance(fault, NoisySensor)
        }

    def inject_faults(self, first_sample: int, response: np.ndarray) -> np.ndarray:
        """Return the readings of the faulty sensors."""
        if not self._faults:
            return response
        faulty = response.copy()
        for index, (fault, row) in enumerate(zip(self._faults, self._rows, strict=True)):
            begin = max(round(fault.start * self._rate) - first_sample, 0)
            values = faulty[row, begin:]
            if values.size == 0:
                continue
            match fault:
                case StuckSensor():
                    values[:] = self._stuck.setdefault(index, float(values[0]))
                case NoisySensor():
                    values += fault.rms * self._noise[index].standard_normal(values.size)
                case DriftingGain():
                    seconds = (first_sample + begin + np.arange(values.size)) / self._rate - fault.start
                    values *= 1.0 + fault.rate * seconds
        return faulty
