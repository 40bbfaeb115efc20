"""A rig's core in this process, for studies: play an experiment, take its first part, estimate its FRF."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_gateway import KnowsItsFrf
from duralab_gateway.motion import DrivePlayback
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, PowerSpectrum
from identifier import (
    Capture,
    Experiment,
    ExperimentSettings,
    FrfEstimate,
    Layout,
    Window,
    design_experiment,
    estimate_experiment,
)
from rig_sim import PlayableRig, play_batch

_NOISE_STREAM = 7919
"""Sets the sensors' noise apart from the drives, which count their seeds from 1."""


def responses_of(playbacks: Sequence[DrivePlayback]) -> list[NDArray[np.float64]]:
    """Play several playbacks together and return their responses.

    Raises
    ------
    RigFaultError
        Of the first that did not come to its end.
    """
    for fault in play_batch(playbacks):
        if fault is not None:
            raise fault
    return [playback.response for playback in playbacks]


@dataclass(frozen=True)
class RigCell:
    """A rig with the way it is excited in a study.

    Parameters
    ----------
    rig
        What plays.
    spectra
        Shape of each drive's PSD.
    levels
        RMS of each drive, in its unit.
    block_samples
        Of every experiment, so that all have the same lines.
    fade_seconds
        At the ends of every experiment and of every burst.
    """

    rig: PlayableRig
    spectra: tuple[PowerSpectrum, ...]
    levels: tuple[float, ...]
    block_samples: int
    fade_seconds: float

    @property
    def sample_rate(self) -> float:
        """Sample rate of the rig, in hertz."""
        return self.rig.specimen.sample_rate

    @property
    def block_seconds(self) -> float:
        """Length of a block, in seconds."""
        return self.block_samples / self.sample_rate

    def settings(self, kind: ExcitationKind, *, seconds: float, seed: int, delay_blocks: int = 1) -> ExperimentSettings:
        """Return an excitation of this rig with one capture block after each delay, as in the paper."""
        return ExperimentSettings(
            kind=kind,
            drive_spectra=self.spectra,
            rms=self.levels,
            duration=seconds,
            block_samples=self.block_samples,
            fade=self.fade_seconds,
            seed=seed,
            delay_blocks=delay_blocks,
            capture_blocks=1,
        )

    def play(self, settings: ExperimentSettings) -> Record:
        """Play an experiment with the sensors' noise, which depends on the excitation's seed."""
        return self.play_all([settings])[0]

    def play_all(self, settings: Iterable[ExperimentSettings]) -> list[Record]:
        """Play several experiments together."""
        experiments = [
            (design_experiment(each, drives=len(self.levels), sample_rate=self.sample_rate), each.seed)
            for each in settings
        ]
        responses = responses_of(
            [self.rig.playback(experiment.drive, seed=_NOISE_STREAM + seed) for experiment, seed in experiments]
        )
        return [Record(experiment, response) for (experiment, _), response in zip(experiments, responses, strict=True)]

    def true_frf(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the FRF (lines, responses, drives) that the rig knows in closed form.

        Raises
        ------
        TypeError
            Where it does not know it.
        """
        if not isinstance(self.rig, KnowsItsFrf):
            raise TypeError(f"{self.rig.specimen.name} does not know its FRF; take aerospace, or a long experiment.")
        return np.asarray(self.rig.sampled_frf(frequency), dtype=np.complex128)


@dataclass(frozen=True)
class Record:
    """Played drive and measured response.

    Parameters
    ----------
    experiment
        Drive and layout.
    response
        Shape (responses, samples).
    """

    experiment: Experiment
    response: NDArray[np.float64]

    @property
    def layout(self) -> Layout:
        """Of the drive."""
        return self.experiment.layout

    def estimate(self, kind: EstimatorKind = EstimatorKind.H1) -> FrfEstimate:
        """Estimate the FRF."""
        return estimate_experiment(
            EstimatorSettings(kind=kind, block_samples=self.layout.block_samples),
            self.layout,
            drive=self.experiment.drive,
            response=self.response,
        )

    def first(self, seconds: float) -> Record | None:
        """Return what an experiment of the same kind that ends after so many seconds has, None where it has nothing.

        A set of orthogonal experiments counts only when it is whole.
        """
        layout = self.layout
        samples = round(seconds * layout.sample_rate)
        if layout.window is Window.HANN:
            usable = samples - 2 * layout.fade_samples
            if usable < layout.block_samples:
                return None
            capture = replace(layout.captures[0], periods=usable // layout.block_samples)
            return self._shortened((capture,), samples)
        columns = 1 + max(capture.experiment for capture in layout.captures)
        within = [
            capture
            for capture in layout.captures
            if capture.start + layout.samples_of(capture) + layout.fade_samples <= samples
        ]
        whole = within[: len(within) - len(within) % columns]
        return self._shortened(tuple(whole), samples) if whole else None

    def _shortened(self, captures: tuple[Capture, ...], samples: int) -> Record:
        kept = min(samples, self.layout.samples)
        layout = replace(self.layout, captures=captures, samples=kept)
        return Record(Experiment(self.experiment.drive[:, :kept], layout), self.response[:, :kept])
