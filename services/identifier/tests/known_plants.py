"""Linear plants whose FRF is known, and the layouts of the records that they answer."""

import numpy as np
from scipy import signal

from identifier.layout import Capture, Layout, Window

RATE = 1000.0
# Second-order sections of a 3 x 2 plant: (numerator, denominator) per response and drive.
PLANT = [
    [([0.2, 0.1], [1.0, -1.7, 0.8]), ([0.0, 0.05], [1.0, -0.5])],
    [([0.1], [1.0, -1.2, 0.6]), ([0.3, -0.2], [1.0, -1.6, 0.75])],
    [([0.0, 0.0, 0.3], [1.0, -0.3]), ([-0.2], [1.0, -0.9])],
]


def resonance(frequency, damping):
    """Return the denominator of a pair of poles."""
    angle = 2 * np.pi * frequency / RATE
    radius = np.exp(-damping * angle)
    return [1.0, -2.0 * radius * np.cos(angle), radius**2]


def lightly_damped(damping):
    """Return a 2 x 2 plant with a resonance at 20 Hz in its first response and one at 37 Hz in its second."""
    first, second = resonance(20.0, damping), resonance(37.0, damping)
    return [
        [([0.0, 0.010], first), ([0.0, 0.003, 0.004], first)],
        [([0.001, 0.020], second), ([0.0, 0.010], second)],
    ]


def respond(drive, plant=PLANT):
    return np.stack([sum(signal.lfilter(*cell, drive[j]) for j, cell in enumerate(row)) for row in plant])


def true_frf(frequency, plant=PLANT):
    rows = [[signal.freqz(*cell, worN=2 * np.pi * frequency / RATE)[1] for cell in row] for row in plant]
    return np.asarray(rows).transpose(2, 0, 1)


class SixModes:
    """A 6 x 6 plant with modes from 11 to 22 Hz at 256 Hz, each seen by every response and moved by every drive."""

    RATE, BLOCK = 256.0, 1024

    def __init__(self, *, damping=0.05, seed=1):
        generator = np.random.default_rng(seed)
        self._shapes, self._participation = generator.standard_normal((2, 6, 6))
        self._sections = []
        for frequency in np.linspace(11.0, 22.0, 6):
            angle = 2 * np.pi * frequency / self.RATE
            pole = np.exp(-damping * angle + 1j * angle)
            denominator = [1.0, -2.0 * pole.real, abs(pole) ** 2]
            height = abs(np.polyval(denominator, np.exp(1j * angle)))
            self._sections.append(([0.0, height], denominator))

    def respond(self, drive):
        modes = self._participation @ drive
        return self._shapes @ np.stack(
            [signal.lfilter(*section, mode) for section, mode in zip(self._sections, modes, strict=True)]
        )

    def error(self, estimate):
        """Return the relative error of an FRF over 1 to 50 Hz."""
        lines = estimate.valid & (estimate.frequency >= 1.0) & (estimate.frequency <= 50.0)
        angle = 2 * np.pi * estimate.frequency[lines] / self.RATE
        modes = np.stack([signal.freqz(*section, worN=angle)[1] for section in self._sections], axis=1)
        expected = np.einsum("ir,fr,rj->fij", self._shapes, modes, self._participation)
        return np.linalg.norm(estimate.frf[lines] - expected) / np.linalg.norm(expected)


def error(estimate, plant=PLANT):
    """Return the relative error of an FRF at the valid lines."""
    expected = true_frf(estimate.frequency[estimate.valid], plant)
    difference = estimate.frf[estimate.valid] - expected
    return np.linalg.norm(difference, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))


def noise_layout(samples, *, block=1024, overlap=0.5, lowest=1.0, highest=100.0, fade=0):
    frequency = np.arange(block // 2 + 1) * (RATE / block)
    return Layout(
        samples=samples,
        sample_rate=RATE,
        block_samples=block,
        fade_samples=fade,
        overlap=overlap,
        periodic=False,
        delay_blocks=0,
        captures=(Capture(start=fade, periods=(samples - 2 * fade) // block, realisation=0, experiment=0),),
        lowest=lowest,
        highest=highest,
        excited=(frequency >= lowest) & (frequency <= highest),
        detection=np.zeros(block // 2 + 1, dtype=bool),
        window=Window.HANN,
    )


def periodic_experiment(*, block=1024, delay=4, periods=2, experiments=4, every=1, drives=2, seed=11):
    """Return a multisine drive with independent phases in each experiment, and its layout."""
    generator = np.random.default_rng(seed)
    excited = np.zeros(block // 2 + 1, dtype=bool)
    excited[2:-1:every] = True
    frequency = np.arange(block // 2 + 1) * (RATE / block)
    pieces, captures = [], []
    for experiment in range(experiments):
        lines = np.zeros((drives, excited.size), dtype=complex)
        lines[:, excited] = np.exp(2j * np.pi * generator.random((drives, excited.sum())))
        captures.append(Capture((experiment * (delay + periods) + delay) * block, periods, experiment, 0))
        pieces.append(np.tile(block * np.fft.irfft(lines, block), delay + periods))
    layout = Layout(
        samples=experiments * (delay + periods) * block,
        sample_rate=RATE,
        block_samples=block,
        fade_samples=0,
        overlap=0.0,
        periodic=True,
        delay_blocks=delay,
        captures=tuple(captures),
        lowest=float(frequency[excited][0]),
        highest=float(frequency[excited][-1]),
        excited=excited,
        detection=np.zeros_like(excited),
        window=Window.NONE,
    )
    return np.concatenate(pieces, axis=1), layout
