"""Rigs with stiff horizontal actuators: every update with and without the drive map, and what a campaign costs.

`python studies/stiff_rig.py` writes picture and tables of docs/studies/stiff_rig.md again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from low_level_campaigns import Trial, campaign, limits_of, play, predecessor_target
from matplotlib.axes import Axes
from numpy.typing import NDArray
from plants_on_arms import Mapped, make_mapped_bench, mapped_errors
from random_plant_campaigns import BAND as PLANT_BAND
from random_plants import SAMPLE_RATE as PLANT_SAMPLE_RATE
from studied_rigs import AXLE_BLOCK
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_drive_map import DriveMap, LearnedDriveMap, learn_drive_map
from duralab_loads import damage_ratio
from duralab_proto.v1 import array_pb2
from duralab_settings import (
    EstimatorKind,
    EstimatorSettings,
    ExcitationKind,
    UpdateKind,
    WhitePinkSpectrum,
)
from duralab_spectra import rms
from identifier import (
    Experiment,
    ExperimentSettings,
    FrfEstimate,
    RigUnderTest,
    ValidBand,
    design_experiment,
    estimate_experiment,
    estimate_shaped,
    row_covariance,
    shape_of,
    shaped_experiment,
)
from iterator import (
    MapFromFirstPlayback,
    ModelUncertainty,
    RigModel,
    UpdateSettings,
    control_band,
    rig_model,
)
from rig_sim import PlayableRig, load_any_rig, shipped_specimens

SAMPLE_RATE: Final = 1000.0
BAND: Final = control_band(0.5, 40.0, sample_rate=SAMPLE_RATE)
IDENTIFIED: Final = (0.25, 46.0)
_SPECTRUM: Final = WhitePinkSpectrum(
    lowest_frequency=IDENTIFIED[0], highest_frequency=IDENTIFIED[1], corner_frequency=1.0, decibels_per_octave=6.0
)
_ESTIMATOR: Final = EstimatorSettings(kind=EstimatorKind.LOCAL_POLYNOMIAL, block_samples=AXLE_BLOCK, local_half_width=6)
#: Of an identification: vertical, lateral and longitudinal, RMS in m.
Level = tuple[float, float, float]
LEVEL: Final[Level] = (0.0025, 4e-5, 1.5e-4)
#: Slope 5 among the exponents of damage.
_SLOPE: Final = 1
_IDENTIFICATION_NOISE, _TARGET_NOISE = 1000, 77
_ONE: Final = np.ones(6)
SECANT: Final = UpdateSettings(
    band=BAND, iteration_gain=_ONE, kind=UpdateKind.SECANT, accept_segments=True, gain_schedule=(0.8, 1.0)
)
#: Name, settings, colour.
UPDATES_TRIED: Final = (
    ("secant update, segment acceptance", SECANT, "#1b5e9b"),
    (
        "basic TWR, gain 0.8",
        UpdateSettings(band=BAND, iteration_gain=0.8 * _ONE, kind=UpdateKind.BASIC_TWR),
        "#c0562a",
    ),
    (
        "Adaptive Modelling, gain 0.8",
        UpdateSettings(band=BAND, iteration_gain=0.8 * _ONE, kind=UpdateKind.ADAPTIVE_MODELLING),
        "#3d8b4f",
    ),
)
#: Gains that keep forces small until the map is learned again, and a level that costs the specimen little.
CAREFUL: Final = SECANT.model_copy(update={"gain_schedule": (0.6, 0.8, 1.0)})
QUIET: Final[Level] = (0.0013, 2e-5, 1e-4)
#: A first experiment that a second one at this share of the target follows, and the gains after it.
FIRST: Final[Level] = (0.001, 2e-5, 1e-4)
SHARE: Final = 0.5
AT_TARGET: Final = SECANT.model_copy(update={"gain_schedule": (0.65, 0.8, 1.0)})
ROAD, OTHER_ROAD, REACHABLE = "road", "other road", "own"
RIGS: Final = ("front_axle", "macpherson")


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds of a target, playbacks, playbacks in a table, plants, their targets."""

    seconds: float
    potholes: int
    playbacks: int
    told: tuple[int, ...]
    experiment_seconds: float
    first_seconds: float
    levels: tuple[Level, ...]
    seeds: tuple[int, ...]
    plants: int
    plant_seconds: float
    plant_playbacks: int


FULL: Final = Extent(
    40.0,
    4,
    7,
    (1, 2, 3, 4, 5, 7),
    75.0,
    38.0,
    ((0.001, 2e-5, 1e-4), (0.002, 3e-5, 1.5e-4), LEVEL, (0.004, 5e-5, 2e-4), (0.008, 1e-4, 2e-4)),
    (1, 2),
    12,
    36.0,
    4,
)
QUICK: Final = Extent(5.0, 1, 2, (1, 2), 38.0, 38.0, (LEVEL,), (1,), 2, 5.0, 2)


@dataclass(frozen=True)
class Identified:
    """A rig that is identified: `plain` from its drives, `learned` with a drive map; `responses` to the experiments."""

    plain: RigModel
    learned: LearnedDriveMap[RigModel]
    responses: tuple[NDArray[np.float64], ...]


@cache
def rig(name: str) -> PlayableRig:
    """Load a shipped rig."""
    return load_any_rig(shipped_specimens()[name])


def experiment_settings(level: Level, *, seconds: float, seed: int) -> ExperimentSettings:
    """Return random orthogonal multisines."""
    return ExperimentSettings(
        kind=ExcitationKind.RANDOM_ORTHOGONAL,
        drive_spectra=(_SPECTRUM,) * 6,
        rms=level * 2,
        duration=seconds,
        block_samples=AXLE_BLOCK,
        fade=1.0,
        seed=seed,
        delay_blocks=1,
        capture_blocks=2,
    )


def model_of(found: FrfEstimate) -> RigModel:
    """Return the model of an estimate."""
    uncertainty = ModelUncertainty(found.residual_psd, row_covariance(found.s_uu, averages=found.averages))
    return rig_model(found.frequency, found.frf, identified_band=IDENTIFIED, uncertainty=uncertainty)


def learned_from(
    name: str,
    weight: NDArray[np.float64],
    experiment: Experiment,
    response: NDArray[np.float64],
    *,
    plain: RigModel,
    estimate: Callable[[NDArray[np.float64]], RigModel] | None,
    start: DriveMap | None = None,
) -> LearnedDriveMap[RigModel]:
    """Learn the drive map from a record, as the identifier does."""
    names = tuple(channel.name for channel in rig(name).specimen.drives)
    return learn_drive_map(
        experiment.drive,
        response,
        model=plain,
        names=names,
        units=("m",) * 6,
        response_weight=weight,
        estimate=estimate,
        start=start,
    )


def identify_mapped(name: str, weight: NDArray[np.float64], *, level: Level, seconds: float, seed: int) -> Identified:
    """Identify a rig with random orthogonal multisines and learn its drive map, as the identifier does."""
    settings = experiment_settings(level, seconds=seconds, seed=seed)
    experiment = design_experiment(settings, drives=6, sample_rate=SAMPLE_RATE)
    response = play(rig(name), experiment.drive, seed=_IDENTIFICATION_NOISE + seed)

    def model(drive: NDArray[np.float64]) -> RigModel:
        return model_of(estimate_experiment(_ESTIMATOR, experiment.layout, drive=drive, response=response))

    plain = model(experiment.drive)
    learned = learned_from(name, weight, experiment, response, plain=plain, estimate=model)
    return Identified(plain, learned, (response,))


def identify_at_target(name: str, target: NDArray[np.float64], extent: Extent, *, seed: int) -> Identified:
    """Identify a rig quietly, then with responses that have the spectra of the target, as the identifier does."""
    weight = 1.0 / rms(target)
    first = identify_mapped(name, weight, level=FIRST, seconds=extent.first_seconds, seed=seed)
    found = first.learned
    uncertainty = found.model.uncertainty
    if uncertainty is None:
        raise AssertionError("The model was made with its uncertainty.")
    wanted = shape_of(
        target,
        names=tuple(each.name for each in rig(name).specimen.responses),
        frf=found.model.frf,
        residual_psd=uncertainty.residual_psd,
        row_covariance=uncertainty.row_covariance,
        band=ValidBand(*IDENTIFIED, SAMPLE_RATE, AXLE_BLOCK),
        drive_map=found.drive_map,
        target_band=(BAND.lowest, BAND.highest),
        level=SHARE,
    )
    channels = tuple(
        array_pb2.Channel(
            name=each.name, minimum=each.minimum, maximum=each.maximum, slew_limit=each.slew_limit, unit="m"
        )
        for each in rig(name).specimen.drives
    )
    described = RigUnderTest(name, SAMPLE_RATE, channels, (), extent.experiment_seconds, "")
    settings = experiment_settings(FIRST, seconds=extent.experiment_seconds, seed=100 + seed)
    experiment, shape = shaped_experiment(wanted, settings, rig=described)
    response = play(rig(name), experiment.drive, seed=_IDENTIFICATION_NOISE + 100 + seed)

    def model(mapped: NDArray[np.float64]) -> RigModel:
        return model_of(estimate_shaped(shape, _ESTIMATOR, experiment.layout, mapped=mapped, response=response))

    plain, start = model(shape.mapped(experiment.drive)), found.drive_map
    learned = learned_from(name, weight, experiment, response, plain=plain, estimate=None, start=start)
    if learned.chosen:
        learned = replace(learned, model=model(learned.drive_map.to_mapped(experiment.drive)))
    return Identified(plain, learned, (*first.responses, response))


def own_target(name: str, drive: NDArray[np.float64], drive_map: DriveMap) -> NDArray[np.float64]:
    """Return the response of the rig to a random drive with the spectra of one for a road, along the rig's arcs.

    Each line of the mapped drive is turned by a random angle, one for all drives, so that what they have in common
    stays.
    """
    mapped = drive_map.to_mapped(drive)
    lines = np.fft.rfft(mapped, axis=1)
    angle = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, lines.shape[1])
    samples = mapped.shape[1]
    rest = np.clip(np.minimum(np.arange(samples), np.arange(samples)[::-1]) / SAMPLE_RATE, 0.0, 1.0)
    random = np.fft.irfft(lines * np.exp(1j * angle), n=samples, axis=1) * rest
    return BAND.limit_target(play(rig(name), drive_map.to_drive(random), seed=_TARGET_NOISE))


def iterated(
    name: str,
    target: NDArray[np.float64],
    found: Identified,
    *,
    update: UpdateSettings,
    playbacks: int,
    how: Mapped,
) -> Trial:
    """Iterate on a rig; what would pass its limits is projected to them."""
    drive_map: DriveMap | MapFromFirstPlayback | None = None
    if how is not Mapped.NOT:
        drive_map = found.learned.drive_map
    if isinstance(drive_map, DriveMap) and how is Mapped.LEARNED_AGAIN:
        drive_map = MapFromFirstPlayback(drive_map.names, drive_map.units, start=drive_map)
    return campaign(
        target,
        model=found.plain if how is Mapped.NOT else found.learned.model,
        update=update,
        playbacks=playbacks,
        rig=rig(name),
        projected_to=limits_of(rig(name)),
        drive_map=drive_map,
    )


@dataclass(frozen=True)
class Course:
    """Result of a campaign, without its records.

    `overall`, `worst`, shape (playbacks,): Relative RMS error over all channels and of the worst one. `largest_force`:
    Of all playbacks and channels, over the largest of the target in that channel. `passes`, shape (channels,): Damage
    that the playbacks spend, in passes of the target, slope 5. `stopped`: Why it ended early.
    """

    overall: NDArray[np.float64]
    worst: NDArray[np.float64]
    largest_force: float
    passes: NDArray[np.float64]
    stopped: str

    @classmethod
    def of(cls, trial: Trial) -> Course:
        """Summarise a campaign."""
        metrics = [step.metrics for step in trial.iterations]
        return cls(
            overall=trial.overall,
            worst=trial.error.max(axis=1),
            largest_force=float(max(each.peak_ratio.max() for each in metrics)),
            passes=np.sum([each.specimen_damage[:, _SLOPE] for each in metrics], axis=0),
            stopped=trial.stopped,
        )


def identification_passes(target: NDArray[np.float64], found: Identified) -> NDArray[np.float64]:
    """Return the damage that an identification spends in each channel, in passes of the target, slope 5."""
    each = [damage_ratio(target, BAND.limit_target(response))[:, _SLOPE] for response in found.responses]
    return np.sum(each, axis=0)


@dataclass(frozen=True)
class Row:
    """One campaign of the table."""

    rig: str
    target: str
    update: str
    colour: str
    how: Mapped
    course: Course


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    roads = {
        ROAD: predecessor_target(extent.seconds, potholes=extent.potholes, depth_m=(0.02, 0.04), band=BAND),
        OTHER_ROAD: predecessor_target(
            extent.seconds, potholes=extent.potholes, depth_m=(0.02, 0.04), road_seed=77, band=BAND
        ),
    }
    rows: list[Row] = []
    targets: dict[tuple[str, str], NDArray[np.float64]] = {}
    for name in RIGS:
        rows += campaigns_of(name, roads, targets, extent)
    levels = levels_table(roads[ROAD], targets["front_axle", REACHABLE], extent)
    careful = careful_table(targets["front_axle", REACHABLE], extent)
    at_target = at_target_table(targets, extent)
    plants = plants_table(extent)
    figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.6), layout="constrained", sharey=True)
    places = (("front_axle", ROAD), ("front_axle", REACHABLE), ("macpherson", ROAD))
    for place, (name, target) in zip(axes, places, strict=True):
        draw(place, [row for row in rows if (row.rig, row.target) == (name, target)], f"{name}, {target} target")
    plain_numbers(*axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return Findings(figure, "\n\n".join((campaigns_table(rows, extent), levels, careful, at_target, plants)))


def campaigns_of(
    name: str,
    roads: dict[str, NDArray[np.float64]],
    targets: dict[tuple[str, str], NDArray[np.float64]],
    extent: Extent,
) -> list[Row]:
    """Iterate one rig to all targets with all updates; adds the targets."""
    found = {
        target: identify_mapped(name, 1.0 / rms(samples), level=LEVEL, seconds=extent.experiment_seconds, seed=1)
        for target, samples in roads.items()
    }
    reached = iterated(
        name, roads[ROAD], found[ROAD], update=SECANT, playbacks=extent.playbacks, how=Mapped.FROM_IDENTIFICATION
    )
    learned = reached.iterations[0].learned
    own_map = found[ROAD].learned.drive_map if learned is None else learned.drive_map
    own = own_target(name, reached.iterations[-1].drive, own_map)
    found[REACHABLE] = identify_mapped(name, 1.0 / rms(own), level=LEVEL, seconds=extent.experiment_seconds, seed=1)
    rows: list[Row] = []
    for target, samples in {**roads, REACHABLE: own}.items():
        targets[name, target] = samples
        for update, settings, colour in UPDATES_TRIED:
            for how in Mapped if settings is SECANT else (Mapped.NOT, Mapped.FROM_IDENTIFICATION):
                trial = iterated(name, samples, found[target], update=settings, playbacks=extent.playbacks, how=how)
                rows.append(Row(name, target, update, colour, how, Course.of(trial)))
    return rows


def draw(axes: Axes, rows: list[Row], title: str) -> None:
    """Draw the worst channel's error over the playbacks."""
    styles = {Mapped.NOT: ":", Mapped.FROM_IDENTIFICATION: "--", Mapped.LEARNED_AGAIN: "-"}
    for row in rows:
        error = row.course.worst
        axes.semilogy(
            np.arange(1, error.size + 1),
            error,
            styles[row.how],
            marker="o",
            ms=3.0,
            color=row.colour,
            label=f"{row.update}, {row.how.value}",
        )
    label(axes, title, across="playback", up="relative RMS error, worst channel")


def campaigns_table(rows: list[Row], extent: Extent) -> str:
    """Write error, largest force and damage of every campaign."""
    head = [
        "rig, target, update, map; error in %: all channels / worst",
        *(f"after {number}" for number in extent.told),
    ]
    head += ["largest force over the target's", "passes spent, worst channel"]
    lines = []
    for row in rows:
        line = [f"{row.rig}, {row.target}, {row.update}, {row.how.value}"]
        for number in extent.told:
            if number <= row.course.overall.size:
                of_all, of_worst = row.course.overall[number - 1], row.course.worst[number - 1]
                line.append(f"{100.0 * of_all:.3g} / {100.0 * of_worst:.3g}")
            else:
                line.append("–")
        line.append(f"{row.course.largest_force:.3g}")
        line.append(f"{row.course.passes.max():.3g}" + (f"; {row.course.stopped}" if row.course.stopped else ""))
        lines.append(line)
    return markdown_table(head, lines)


def levels_table(road: NDArray[np.float64], own: NDArray[np.float64], extent: Extent) -> str:
    """Write what the level of the identification costs, and what it gives."""
    head = ["identified at, mm RMS, vertical / lateral / longitudinal", "target", "passes of the identification"]
    head += [f"worst channel after {number}" for number in (1, 2)] + ["passes of two playbacks, worst channel"]
    lines = []
    for level in extent.levels:
        for name, target in ((ROAD, road), (REACHABLE, own)):
            spent, errors, played = [], [], []
            for seed in extent.seeds:
                found = identify_mapped(
                    "front_axle", 1.0 / rms(target), level=level, seconds=extent.experiment_seconds, seed=seed
                )
                trial = iterated(
                    "front_axle", target, found, update=SECANT, playbacks=2, how=Mapped.FROM_IDENTIFICATION
                )
                course = Course.of(trial)
                spent.append(identification_passes(target, found).max())
                errors.append(course.worst)
                played.append(course.passes.max())
            error = np.median(errors, axis=0)
            lines.append(
                [
                    " / ".join(f"{1e3 * each:g}" for each in level),
                    name,
                    f"{np.median(spent):.3g}",
                    *(percent(float(each)) for each in error),
                    f"{np.median(played):.3g}",
                ]
            )
    return markdown_table(head, lines)


def careful_table(own: NDArray[np.float64], extent: Extent) -> str:
    """Write what campaigns with small first steps, and a map that is learned again, cost the specimen."""
    playbacks = min(5, extent.playbacks)
    head = ["identified at, mm RMS; gains; seed; front_axle, own target", "passes of the identification"]
    head += [f"worst channel after {number}" for number in range(1, playbacks + 1)] + [
        "largest force over the target's"
    ]
    head += [f"passes with {number} playbacks (goal {1.5 * (number + 1):g})" for number in (playbacks - 1, playbacks)]
    lines = []
    for level, update in ((LEVEL, CAREFUL), (QUIET, CAREFUL), (None, AT_TARGET)):
        for seed in (*extent.seeds, max(extent.seeds) + 1):
            if level is None:
                found = identify_at_target("front_axle", own, extent, seed=seed)
            else:
                seconds = extent.experiment_seconds
                found = identify_mapped("front_axle", 1.0 / rms(own), level=level, seconds=seconds, seed=seed)
            trial = iterated("front_axle", own, found, update=update, playbacks=playbacks, how=Mapped.LEARNED_AGAIN)
            course, before = Course.of(trial), identification_passes(own, found)
            each = np.array([step.metrics.specimen_damage[:, _SLOPE] for step in trial.iterations])
            spent = before + np.cumsum(each, axis=0)
            told = " / ".join(f"{1e3 * part:g}" for part in level or FIRST)
            told += f", then at {SHARE:g} of the target" if level is None else ""
            lines.append(
                [
                    f"{told}; {', '.join(f'{gain:g}' for gain in update.gain_schedule)}; {seed}",
                    f"{before.max():.3g}",
                    *(percent(float(error)) for error in course.worst),
                    f"{course.largest_force:.3g}",
                    *(f"{spent[number - 1].max():.3g}" for number in (playbacks - 1, playbacks)),
                ]
            )
    return markdown_table(head, lines)


def at_target_table(targets: dict[tuple[str, str], NDArray[np.float64]], extent: Extent) -> str:
    """Write campaigns after a second experiment at the target, on every rig and target."""
    head = ["rig, target, gains, identified at the target; error in %: all channels / worst"]
    head += [f"after {number}" for number in extent.told]
    head += ["largest force over the target's", "passes of the identification", "passes with 4 playbacks"]
    lines = []
    for (name, which), target in targets.items():
        found = identify_at_target(name, target, extent, seed=1)
        before = identification_passes(target, found)
        for update in (SECANT, AT_TARGET):
            trial = iterated(name, target, found, update=update, playbacks=extent.playbacks, how=Mapped.LEARNED_AGAIN)
            course = Course.of(trial)
            four = np.sum([step.metrics.specimen_damage[:, _SLOPE] for step in trial.iterations[:4]], axis=0)
            lines.append(
                [
                    f"{name}, {which}, {', '.join(f'{gain:g}' for gain in update.gain_schedule)}",
                    *(
                        f"{100.0 * course.overall[number - 1]:.3g} / {100.0 * course.worst[number - 1]:.3g}"
                        for number in extent.told
                    ),
                    f"{course.largest_force:.3g}",
                    f"{before.max():.3g}",
                    f"{(before + four).max():.3g}",
                ]
            )
    return markdown_table(head, lines)


def plants_table(extent: Extent) -> str:
    """Write the errors on random plants with arcs and without."""
    head = [f"{extent.plants} random plants, secant update", "terms chosen"]
    told = [number for number in extent.told if number <= extent.plant_playbacks]
    head += [f"median after {number}" for number in told] + [f"worst after {told[-1]}"]
    settings = UpdateSettings(
        band=PLANT_BAND,
        iteration_gain=_ONE,
        kind=UpdateKind.SECANT,
        accept_segments=True,
        gain_schedule=(0.8, 1.0),
    )
    lines = []
    for arms in (True, False):
        bench = make_mapped_bench(
            extent.plants, samples=round(extent.plant_seconds * PLANT_SAMPLE_RATE), seed=1, arms=arms
        )
        terms = [len(each.chosen) for each in bench.mapped]
        for how in Mapped if arms else (Mapped.LEARNED_AGAIN,):
            error = mapped_errors(bench, settings, how=how, playbacks=extent.plant_playbacks, seed=2)
            line = [f"{'wheels on arcs' if arms else 'without arcs'}, {how.value}"]
            line.append("–" if how is Mapped.NOT else f"{min(terms)} to {max(terms)}")
            line += [percent(float(np.median(error[:, number - 1]))) for number in told]
            lines.append([*line, percent(float(error[:, -1].max()))])
    return markdown_table(head, lines)


if __name__ == "__main__":
    run("stiff_rig", study)
