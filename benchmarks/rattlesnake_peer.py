"""Rattlesnake's spectral processing on a record, without its processes, queues and windows; in its own environment."""

from __future__ import annotations

import os
import queue
from collections.abc import Iterator

import numpy as np
from identification_records import BLOCK, OVERLAP, RATE

# Its estimates come from frames that another of its processes has windowed and transformed; so much is done here.
_HOP = round(BLOCK * (1.0 - OVERLAP))
_WINDOW = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(BLOCK) / BLOCK)


def rattlesnake_h1(drive: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Return its H1, with what it computes beside: coherence, power spectra and the condition of every line.

    Parameters
    ----------
    drive, response : ndarray, (channels, samples)

    Returns
    -------
    ndarray, (lines, responses, drives)
    """
    # It opens a GUI's application where it is imported.
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    from rattlesnake.components import spectral_processing as peer

    frames = list(zip(_transformed(response), _transformed(drive), strict=True))
    nobody, results = _Nobody(), queue.SimpleQueue()
    process = peer.SpectralProcessingProcess("", nobody, _Given(frames), results, nobody, nobody, nobody, "")
    process.initialize_parameters(
        peer.SpectralProcessingMetadata(
            peer.AveragingTypes.LINEAR,
            len(frames),
            0.0,
            peer.Estimator.H1,
            response.shape[0],
            drive.shape[0],
            RATE / BLOCK,
            RATE,
            BLOCK // 2 + 1,
            compute_cpsd=False,
        )
    )
    process.run_spectral_processing(None)
    return results.get()[2]


def _transformed(record: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the lines of every block: (channels, lines)."""
    for start in range(0, record.shape[1] - BLOCK + 1, _HOP):
        yield np.fft.rfft(record[:, start : start + BLOCK] * _WINDOW)


class _Given:
    """A queue of frames that is empty after the last one."""

    def __init__(self, frames: list[tuple[np.ndarray, np.ndarray]]) -> None:
        self._frames = iter(frames)

    def get(self, block: bool = True, timeout: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the next frame."""
        del block, timeout
        for frame in self._frames:
            return frame
        raise queue.Empty


class _Nobody:
    """Takes what is put and drops it: logs, and commands to itself."""

    def put(self, *message: object) -> None:
        """Drop it."""
