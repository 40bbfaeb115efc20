"""Campaigns on random plants whose wheels move on arcs: without a drive map, with one, and with one learned again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray
from random_plant_campaigns import BAND, measured
from random_plants import (
    CHANNELS,
    REFERENCE_DEFLECTION,
    SAMPLE_RATE,
    Plants,
    another_vehicle,
    draw_plants,
    on_arms,
    play,
    road_motion,
)
from scipy.signal import butter, sosfilt

from duralab_drive_map import DriveMap, LearnedDriveMap, learn_drive_map
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, WhitePinkSpectrum
from duralab_spectra import overall_relative_rms_error, rms
from identifier import ExperimentSettings, design_experiment, estimate_experiment, row_covariance
from iterator import UPDATES, IterationHistory, ModelUncertainty, Playback, RigModel, UpdateSettings, rig_model

NAMES: Final = tuple(f"{side} {axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal"))
UNITS: Final = ("m",) * CHANNELS
_IDENTIFIED: Final = (0.5, 34.0)
_EXPERIMENT_SECONDS: Final = 75.0
_BLOCK: Final = 512
_ESTIMATOR: Final = EstimatorSettings(kind=EstimatorKind.LOCAL_POLYNOMIAL, block_samples=_BLOCK, local_half_width=6)
#: Drive level of the identification, and noise of the sensors, relative to the target's.
_LEVEL, _NOISE = 0.25, 0.01


class Mapped(Enum):
    """Treatment of the arcs by a campaign."""

    NOT = "no map"
    FROM_IDENTIFICATION = "map of the identification"
    LEARNED_AGAIN = "map learned again after playback 1"


@dataclass(frozen=True)
class MappedBench:
    """Plants with their targets, and the results of their identification.

    Parameters
    ----------
    plants : Plants
        The rigs.
    targets : ndarray, shape (plants, n_y, samples)
        In the control band, N.
    plain : tuple of RigModel
        From drives to responses.
    mapped : tuple of LearnedDriveMap
        With models from mapped drives to responses.
    """

    plants: Plants
    targets: NDArray[np.float64]
    plain: tuple[RigModel, ...]
    mapped: tuple[LearnedDriveMap[RigModel], ...]


def make_mapped_bench(count: int, *, samples: int, seed: int, arms: bool) -> MappedBench:
    """Draw plants, measure the predecessors, whose wheels follow no arc, and identify the plants."""
    rng = np.random.default_rng(seed)
    plants = draw_plants(count, rng=rng)
    passed = butter(2, 0.8, "high", fs=SAMPLE_RATE, output="sos")
    motion = np.stack([sosfilt(passed, road_motion(samples=samples, seed=seed + i), axis=1) for i in range(count)])
    motion *= 1.6 * REFERENCE_DEFLECTION[:, None] / np.sqrt(np.mean(motion**2, axis=2, keepdims=True))
    motion *= np.clip(np.minimum(np.arange(samples), np.arange(samples)[::-1]) / SAMPLE_RATE, 0.0, 1.0)
    targets = play(another_vehicle(plants, rng=rng), motion)
    speed = np.sqrt(np.mean(np.diff(motion, axis=2) ** 2, axis=2)).T * SAMPLE_RATE
    plants = replace(plants, valve_speed=rng.uniform(4.0, 8.0, speed.shape) * speed)
    if arms:
        plants = on_arms(plants, rng=rng)
    limited = np.stack([BAND.limit_target(target) for target in targets])
    plain, mapped = _identified(plants, limited, seed=seed, rng=rng)
    return MappedBench(plants, limited, plain, mapped)


def _identified(
    plants: Plants, targets: NDArray[np.float64], *, seed: int, rng: np.random.Generator
) -> tuple[tuple[RigModel, ...], tuple[LearnedDriveMap[RigModel], ...]]:
    spectrum = WhitePinkSpectrum(
        lowest_frequency=_IDENTIFIED[0], highest_frequency=_IDENTIFIED[1], corner_frequency=2.0, decibels_per_octave=3.0
    )
    settings = ExperimentSettings(
        kind=ExcitationKind.RANDOM_ORTHOGONAL,
        drive_spectra=(spectrum,) * CHANNELS,
        rms=tuple(_LEVEL * 1.6 * REFERENCE_DEFLECTION),
        duration=_EXPERIMENT_SECONDS,
        block_samples=_BLOCK,
        fade=1.0,
        seed=seed,
        delay_blocks=1,
        capture_blocks=2,
    )
    experiment = design_experiment(settings, drives=CHANNELS, sample_rate=SAMPLE_RATE)
    scale = np.stack([rms(target) for target in targets])
    drive = np.broadcast_to(experiment.drive, (len(targets), *experiment.drive.shape))
    responses = measured(plants, drive, played=play, noise=_NOISE * scale, rng=rng)
    plain: list[RigModel] = []
    mapped: list[LearnedDriveMap[RigModel]] = []
    for response, level in zip(responses, scale, strict=True):

        def model(
            driven: NDArray[np.float64],
            response: NDArray[np.float64] = response,
            weight: NDArray[np.float64] = 1.0 / level,
        ) -> RigModel:
            found = estimate_experiment(_ESTIMATOR, experiment.layout, drive=driven, response=response)
            uncertainty = ModelUncertainty(found.residual_psd, row_covariance(found.s_uu, averages=found.averages))
            return rig_model(
                found.frequency,
                found.frf,
                identified_band=_IDENTIFIED,
                response_weight=weight,
                uncertainty=uncertainty,
            )

        plain.append(model(experiment.drive))
        mapped.append(
            learn_drive_map(
                experiment.drive,
                response,
                model=plain[-1],
                names=NAMES,
                units=UNITS,
                response_weight=1.0 / level,
                estimate=model,
            )
        )
    return tuple(plain), tuple(mapped)


def mapped_errors(
    bench: MappedBench, settings: UpdateSettings, *, how: Mapped, playbacks: int, seed: int
) -> NDArray[np.float64]:
    """Iterate on all plants and return the relative RMS error over all channels, shape (plants, playbacks)."""
    rng = np.random.default_rng(seed)
    update, count = UPDATES[settings.kind], len(bench.plain)
    noise = _NOISE * np.stack([rms(target) for target in bench.targets])
    maps: list[DriveMap] = [
        replace(each.drive_map, terms=()) if how is Mapped.NOT else each.drive_map for each in bench.mapped
    ]
    identified = bench.plain if how is Mapped.NOT else tuple(each.model for each in bench.mapped)
    models, histories = list(identified), [IterationHistory(target=target) for target in bench.targets]
    errors = np.empty((count, playbacks))
    for number in range(playbacks):
        mapped: list[NDArray[np.float64]] = []
        for i in range(count):
            used = settings if maps[i].is_identity else settings.without_rate_limits
            step = update(histories[i], models[i], used)
            models[i] = step.model
            mapped.append(step.drive)
        drives = [maps[i].to_drive(mapped[i]) for i in range(count)]
        responses = measured(bench.plants, np.stack(drives), played=play, noise=noise, rng=rng)
        for i in range(count):
            response = BAND.limit_response(responses[i])
            errors[i, number] = overall_relative_rms_error(bench.targets[i], response)
            if number == 0 and how is Mapped.LEARNED_AGAIN and not maps[i].is_identity:
                learned = learn_drive_map(
                    drives[i],
                    responses[i],
                    model=identified[i],
                    names=NAMES,
                    units=UNITS,
                    response_weight=1.0 / rms(bench.targets[i]),
                    start=maps[i],
                )
                maps[i] = learned.drive_map
                mapped[i] = BAND.limit_drive(maps[i].to_mapped(drives[i]))
            histories[i] = histories[i].after(Playback(drive=mapped[i], response=response))
    return errors
