"""Campaigns on the front axle with a model from a level at which its friction sticks, target from the predecessor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from studied_rigs import AXLE_BLOCK, front_axle_compliant

import duralab_roads
from duralab_drive_map import DriveMap
from duralab_settings import (
    EstimatorKind,
    EstimatorSettings,
    ExcitationKind,
    LimitPolicy,
    PowerSpectrum,
    StopCriteria,
    WhitePinkSpectrum,
)
from identifier import ExperimentSettings, design_experiment, estimate_experiment, row_covariance
from iterator import (
    NO_BOUNDS,
    CampaignSettings,
    ControlBand,
    DriveLimitError,
    DriveLimits,
    Iteration,
    MapFromFirstPlayback,
    ModelUncertainty,
    RigModel,
    UpdateSettings,
    control_band,
    iterate,
    rig_model,
)
from rig_sim import PlayableRig, RigFaultError, load_any_rig, shipped_specimens

SAMPLE_RATE: Final = 1000.0
#: Studies look at rigs that are held far below what a target needs.
LARGEST_OVERRUN: Final = 100.0
BAND: Final = control_band(0.7, 35.0, sample_rate=SAMPLE_RATE)
#: RMS of the drives that reproduce the target, rounded: vertical, lateral and longitudinal, left and right, m.
OPERATIONAL: Final = np.array([0.0135, 0.0009, 0.00085] * 2)
#: Rows of the longitudinal forces among the responses, left and right.
LONGITUDINAL: Final = (2, 5)
IDENTIFIED: Final = (0.4, 45.0)
DISPLACEMENT: Final = WhitePinkSpectrum(
    lowest_frequency=IDENTIFIED[0], highest_frequency=IDENTIFIED[1], corner_frequency=2.0, decibels_per_octave=3.0
)
#: Two realisations of six experiments with one delay and two captured blocks each.
_EXPERIMENT_SECONDS: Final = 75.0
_ESTIMATOR: Final = EstimatorSettings(kind=EstimatorKind.LOCAL_POLYNOMIAL, block_samples=AXLE_BLOCK, local_half_width=6)
_SPEED: Final = 15.0
_ROAD_SEED: Final = 8608
_POTHOLE_SEED: Final = 1
#: The predecessor's tyre, as in a campaign's target: track width, radius, length and width of contact, m.
_TRACK_WIDTH: Final = 1.51
_RADIUS, _CONTACT_LENGTH, _CONTACT_WIDTH = 0.3265, 0.12, 0.19
#: Sensor noise: of the target, of the identification and of the first playback.
_TARGET_NOISE, _IDENTIFICATION_NOISE, _PLAYBACK_NOISE = 1, 1000, 2000


@dataclass(frozen=True)
class Trial:
    """Result of one algorithm.

    Parameters
    ----------
    iterations : tuple of Iteration
        As far as it came.
    stopped : str
        Why it ended before its last playback; empty where it did not.
    """

    iterations: tuple[Iteration, ...]
    stopped: str

    @property
    def error(self) -> NDArray[np.float64]:
        """Relative RMS error, shape (playbacks, responses)."""
        return np.array([step.metrics.relative_rms_error for step in self.iterations])

    @property
    def rms_response(self) -> NDArray[np.float64]:
        """RMS response, shape (playbacks, responses)."""
        return np.array([step.metrics.rms_response for step in self.iterations])

    @property
    def overall(self) -> NDArray[np.float64]:
        """Relative RMS error over all channels, shape (playbacks,)."""
        return np.array([step.metrics.overall_relative_rms_error for step in self.iterations])

    @property
    def longitudinal(self) -> NDArray[np.float64]:
        """Relative RMS error of the worse longitudinal channel, shape (playbacks,)."""
        return self.error[:, LONGITUDINAL].max(axis=1)


def predecessor_target(
    seconds: float,
    *,
    potholes: int,
    vehicle: PlayableRig | None = None,
    road_seed: int = _ROAD_SEED,
    depth_m: tuple[float, float] = (0.02, 0.05),
    band: ControlBand = BAND,
) -> NDArray[np.float64]:
    """Drive the predecessor over a C/D road with potholes and return its responses in the control band.

    They are the spindle forces in N, or those of the vehicle that is given, which drives as the predecessor does.
    """
    samples = round(seconds * SAMPLE_RATE)
    smooth = duralab_roads.iso8608_road(road_class="C/D", length_m=max(60.0, _SPEED * seconds + 1.0), seed=road_seed)
    road = duralab_roads.add_potholes(
        smooth,
        count=potholes,
        seed=int(np.random.SeedSequence([road_seed, _POTHOLE_SEED]).generate_state(1)[0]),
        lead_in_m=_SPEED,
        track_width_m=_TRACK_WIDTH,
        length_m=(0.4, 1.0),
        depth_m=depth_m,
    )
    inputs = duralab_roads.effective_inputs(
        road,
        speed=_SPEED,
        sample_rate=SAMPLE_RATE,
        samples=samples,
        track_width=_TRACK_WIDTH,
        tyre_radius=_RADIUS,
        contact_length=_CONTACT_LENGTH,
        contact_width=_CONTACT_WIDTH,
        lead_in_seconds=1.0,
        axle_distances=(0.0,),
    )
    driven = load_any_rig(shipped_specimens()["predecessor"]) if vehicle is None else vehicle
    rows: dict[str, NDArray[np.float64]] = dict(zip(duralab_roads.EFFECTIVE_INPUTS, inputs, strict=True))
    speed = np.full(samples, _SPEED)
    drive = np.array([rows.get(channel.name, speed) for channel in driven.specimen.drives])
    return band.limit_target(play(driven, drive, seed=_TARGET_NOISE))


@cache
def identified(share: float, seed: int) -> RigModel:
    """Identify the rig at a share of the operational drive RMS; the seed is of phases and noise."""
    return identify(front_axle_compliant().rig, levels=share * OPERATIONAL, seed=seed)


def identify(
    rig: PlayableRig,
    *,
    levels: NDArray[np.float64],
    seed: int,
    spectra: tuple[PowerSpectrum, ...] | None = None,
    seconds: float = _EXPERIMENT_SECONDS,
    estimator: EstimatorSettings = _ESTIMATOR,
    response_weight: NDArray[np.float64] | None = None,
) -> RigModel:
    """Identify a rig with random orthogonal multisines of the given RMS; displacements where no spectra are given."""
    settings = ExperimentSettings(
        kind=ExcitationKind.RANDOM_ORTHOGONAL,
        drive_spectra=(DISPLACEMENT,) * levels.size if spectra is None else spectra,
        rms=tuple(levels),
        duration=seconds,
        block_samples=AXLE_BLOCK,
        fade=1.0,
        seed=seed,
        delay_blocks=1,
        capture_blocks=2,
    )
    experiment = design_experiment(settings, drives=levels.size, sample_rate=SAMPLE_RATE)
    estimate = estimate_experiment(
        estimator,
        experiment.layout,
        drive=experiment.drive,
        response=play(rig, experiment.drive, seed=_IDENTIFICATION_NOISE + seed),
    )
    uncertainty = ModelUncertainty(estimate.residual_psd, row_covariance(estimate.s_uu, averages=estimate.averages))
    return rig_model(
        estimate.frequency,
        estimate.frf,
        identified_band=IDENTIFIED,
        response_weight=response_weight,
        uncertainty=uncertainty,
    )


def campaign(
    target: NDArray[np.float64],
    *,
    model: RigModel,
    update: UpdateSettings,
    playbacks: int,
    rig: PlayableRig | None = None,
    projected_to: DriveLimits | None = None,
    drive_map: DriveMap | MapFromFirstPlayback | None = None,
) -> Trial:
    """Iterate on a rig until the last playback, or until the rig's limits or the rig itself end it.

    The rig is the front axle unless another one is given. Drives beyond its limits are refused, unless limits are given
    that they are projected to.
    """
    played_on = front_axle_compliant().rig if rig is None else rig
    noise = iter(range(_PLAYBACK_NOISE, _PLAYBACK_NOISE + playbacks))
    policy = LimitPolicy.REFUSE if projected_to is None else LimitPolicy.PROJECT
    done: list[Iteration] = []
    try:
        for step in iterate(
            lambda drive: play(played_on, drive, seed=next(noise)),
            target,
            model=model,
            settings=CampaignSettings(
                update=update,
                stop=StopCriteria(iterations=playbacks, **NO_BOUNDS),
                limit_policy=policy,
                largest_overrun=LARGEST_OVERRUN,
            ),
            limits=limits_of(played_on) if projected_to is None else projected_to,
            drive_map=drive_map,
        ):
            done.append(step)
    except DriveLimitError:
        return Trial(tuple(done), f"playback {len(done) + 1} refused: beyond the rig's limits")
    except RigFaultError:
        return Trial(tuple(done), f"the rig faults in playback {len(done) + 1}")
    return Trial(tuple(done), "")


def play(rig: PlayableRig, drive: NDArray[np.float64], *, seed: int) -> NDArray[np.float64]:
    """Play a drive and return the response; the seed is of the sensors' noise."""
    run = rig.playback(drive, seed=seed)
    for _ in run.blocks():
        pass
    return run.response


def limits_of(rig: PlayableRig) -> DriveLimits:
    """Return what the rig allows its drives."""
    channels = rig.specimen.drives
    return DriveLimits(
        names=tuple(channel.name for channel in channels),
        units=tuple(channel.unit for channel in channels),
        minimum=np.array([channel.minimum for channel in channels]),
        maximum=np.array([channel.maximum for channel in channels]),
        slew_limit=np.array([channel.slew_limit for channel in channels]),
        sample_rate=rig.specimen.sample_rate,
        actuator_speed=np.array([channel.actuator_speed for channel in channels]),
    )
