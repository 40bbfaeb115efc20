"""Campaigns on many random plants at once: identified softly, then iterated side by side with the iterator's core."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from random_plants import (
    CHANNELS,
    REFERENCE_DEFLECTION,
    SAMPLE_RATE,
    Plants,
    another_vehicle,
    draw_plants,
    play,
    play_forces,
    road_motion,
)
from scipy.signal import butter, sosfilt

from duralab_spectra import line_frequencies, overall_relative_rms_error, rms
from iterator import (
    UPDATES,
    IterationHistory,
    ModelUncertainty,
    Playback,
    RigModel,
    UpdateSettings,
    control_band,
    rig_model,
)

BAND: Final = control_band(2.0, 30.0, sample_rate=SAMPLE_RATE)
_EXPERIMENTS: Final = 12
_CAPTURED: Final = 2
_IDENTIFIED: Final = (0.5, 34.0)
#: RMS of the motion that a target comes from, over the typical deflection: of rigs driven by strokes and by forces.
_MOTION, _FORCED_MOTION = 1.6, 0.8

PlayPlants = Callable[[Plants, NDArray[np.float64]], NDArray[np.float64]]
"""Plays drives on plants: `play`, or `play_forces`."""


@dataclass(frozen=True)
class Conditions:
    """How rigs are identified and measured, and how they change.

    Parameters
    ----------
    noise : float
        RMS of the sensors' noise, relative to the target's.
    level : float
        Drive level of the identification, relative to the target's.
    block_samples : int
        Of the identification and of all updates.
    softening : float
        Share of its stiffness and of its friction that a suspension loses from one playback to the next.
    """

    noise: float = 0.01
    level: float = 0.12
    block_samples: int = 512
    softening: float = 0.0


@dataclass(frozen=True)
class Bench:
    """Plants with their models and targets, one of each for every plant.

    Parameters
    ----------
    plants : Plants
        The rigs.
    targets : ndarray, shape (plants, n_y, samples)
        In the control band, N.
    models : tuple of RigModel
        As identified.
    conditions : Conditions
        Of identification and playbacks.
    play : callable
        What the plants make of drives.
    """

    plants: Plants
    targets: NDArray[np.float64]
    models: tuple[RigModel, ...]
    conditions: Conditions
    play: PlayPlants = play


def make_bench(
    count: int, *, samples: int, seed: int, conditions: Conditions = Conditions(), forced: bool = False
) -> Bench:
    """Draw plants and roads, measure the predecessors on them, identify the rigs.

    Parameters
    ----------
    count : int
        Plants.
    samples : int
        Length of a target.
    seed : int
        Of everything.
    conditions : Conditions, optional
        The same plants and roads whatever they are.
    forced : bool, optional
        Whether forces drive masses on springs that stiffen, in place of strokes that drive suspensions.

    Returns
    -------
    Bench
        Ready to iterate.
    """
    rng = np.random.default_rng(seed)
    plants = draw_plants(count, rng=rng)
    passed = butter(2, 0.8, "high", fs=SAMPLE_RATE, output="sos")
    motion = np.stack([sosfilt(passed, road_motion(samples=samples, seed=seed + i), axis=1) for i in range(count)])
    level = (_FORCED_MOTION if forced else _MOTION) * REFERENCE_DEFLECTION[:, None]
    motion *= level / np.sqrt(np.mean(motion**2, axis=2, keepdims=True))
    rest = np.clip(np.minimum(np.arange(samples), np.arange(samples)[::-1]) / SAMPLE_RATE, 0.0, 1.0)
    motion *= rest
    played = play_forces if forced else play
    targets = played(another_vehicle(plants, rng=rng), motion)
    speed = np.sqrt(np.mean(np.diff(motion, axis=2) ** 2, axis=2)).T * SAMPLE_RATE
    plants = replace(plants, valve_speed=rng.uniform(4.0, 8.0, speed.shape) * speed)
    return Bench(
        plants=plants,
        targets=np.stack([BAND.limit_target(target) for target in targets]),
        models=_identified(plants, targets, played=played, conditions=conditions, rng=rng),
        conditions=conditions,
        play=played,
    )


def measured(
    plants: Plants,
    drive: NDArray[np.float64],
    *,
    played: PlayPlants,
    noise: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Play and add the sensors' noise of the given RMS, shape (plants, n_y)."""
    return played(plants, drive) + noise[:, :, None] * rng.standard_normal(drive.shape)


def softened(plants: Plants, share: float) -> Plants:
    """Return plants with so much of their stiffness and friction: rubber that warms and wears."""
    return replace(
        plants,
        stiffness=share * plants.stiffness,
        coupling=share * plants.coupling,
        friction_force=share * plants.friction_force,
        friction_stiffness=share * plants.friction_stiffness,
    )


def errors_of(bench: Bench, settings: UpdateSettings, *, playbacks: int, seed: int) -> NDArray[np.float64]:
    """Iterate on all plants and return the relative RMS error over all channels, shape (plants, playbacks)."""
    rng = np.random.default_rng(seed)
    update = UPDATES[settings.kind]
    count = len(bench.models)
    noise = bench.conditions.noise * np.stack([rms(target) for target in bench.targets])
    histories = [IterationHistory(target=target) for target in bench.targets]
    models = list(bench.models)
    errors = np.empty((count, playbacks))
    for number in range(playbacks):
        drives = []
        for i in range(count):
            step = update(histories[i], models[i], settings)
            models[i] = step.model
            drives.append(step.drive)
        plants = softened(bench.plants, (1.0 - bench.conditions.softening) ** number)
        responses = measured(plants, np.stack(drives), played=bench.play, noise=noise, rng=rng)
        for i in range(count):
            response = BAND.limit_response(responses[i])
            errors[i, number] = overall_relative_rms_error(bench.targets[i], response)
            histories[i] = histories[i].after(Playback(drive=drives[i], response=response))
    return errors


def _identified(
    plants: Plants,
    targets: NDArray[np.float64],
    *,
    played: PlayPlants,
    conditions: Conditions,
    rng: np.random.Generator,
) -> tuple[RigModel, ...]:
    """H1 from softly played random-phase multisines, one block to settle and the others to average."""
    count, samples = targets.shape[0], conditions.block_samples
    frequency = line_frequencies(samples, SAMPLE_RATE)
    driven = (frequency >= _IDENTIFIED[0]) & (frequency <= _IDENTIFIED[1])
    level = np.where(driven, 1.0 / np.maximum(frequency, 3.0), 0.0)
    s_uu = np.zeros((count, frequency.size, CHANNELS, CHANNELS), dtype=np.complex128)
    s_yu = np.zeros_like(s_uu)
    s_yy = np.zeros((count, frequency.size, CHANNELS))
    scale = np.sqrt(np.mean(targets**2, axis=2))
    for _ in range(_EXPERIMENTS):
        phase = rng.uniform(0.0, 2.0 * np.pi, (count, CHANNELS, frequency.size))
        block = np.fft.irfft(level * np.exp(1j * phase), n=samples, axis=2)
        wanted = conditions.level * _MOTION * REFERENCE_DEFLECTION[:, None]
        block *= wanted / np.sqrt(np.mean(block**2, axis=2, keepdims=True))
        drive = np.tile(block, (1, 1, 1 + _CAPTURED))
        response = measured(plants, drive, played=played, noise=conditions.noise * scale, rng=rng)
        for k in range(1, 1 + _CAPTURED):
            piece = slice(k * samples, (k + 1) * samples)
            u, y = (np.fft.rfft(x[:, :, piece], axis=2).transpose(0, 2, 1) for x in (drive, response))
            s_uu += u[..., :, None] * u[..., None, :].conj()
            s_yu += y[..., :, None] * u[..., None, :].conj()
            s_yy += np.abs(y) ** 2
    blocks = _EXPERIMENTS * _CAPTURED
    models = []
    for i in range(count):
        spread = np.zeros_like(s_uu[i])
        spread[driven] = np.linalg.inv(s_uu[i][driven])
        frf = np.matmul(s_yu[i], spread)
        residual = np.maximum(s_yy[i] - np.einsum("fij,fij->fi", frf, s_yu[i].conj()).real, 0.0)
        models.append(
            rig_model(
                frequency,
                frf,
                identified_band=_IDENTIFIED,
                response_weight=1.0 / scale[i],
                uncertainty=ModelUncertainty(residual / (blocks - CHANNELS), spread.conj()),
            )
        )
    return tuple(models)
