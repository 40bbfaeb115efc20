"""Drives corrected for a worn specimen: errors after "iterate again", against those its campaign ended with.

`python studies/iterating_again.py` writes picture and tables of docs/studies/iterating_again.md again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from low_level_campaigns import LARGEST_OVERRUN, limits_of, predecessor_target
from matplotlib.axes import Axes
from numpy.typing import NDArray
from stiff_rig import BAND, LEVEL, SAMPLE_RATE, SECANT, Identified, identify_mapped
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_settings import LimitPolicy, StopCriteria
from duralab_spectra import rms
from iterator import NO_BOUNDS, CampaignSettings, Iteration, Play, UpdateSettings, iterate
from iterator.playbacks import NOTHING_KNOWN, FirstDrive, KnownBefore
from rig_sim import Condition, Lost, Rig, load_rig, shipped_specimens
from sequencer.endurance.iterate_again import update_of_worn

NAME: Final = "front_axle_wearing"
RIG: Final[Rig] = load_rig(shipped_specimens()[NAME])
BUSHING: Final = "left_lower_rear_bushing"
#: Name and loss, colour.
LOSSES: Final = (
    ("bushing, 10 %", {BUSHING: Lost(stiffness=0.1, damping=0.1)}, "#3d8b4f"),
    ("damper, 60 %", {"left_strut_damper": Lost(damping=0.6)}, "#d9a441"),
    ("bushing, 30 %", {BUSHING: Lost(stiffness=0.3, damping=0.3)}, "#1b5e9b"),
    ("tie rod cracked, 80 %", {"left_tie_rod": Lost(stiffness=0.8, damping=0.8)}, "#c0562a"),
)
#: Seed of the road, and seconds, by name.
TARGETS: Final = {"road": (8608, 20.0), "other road": (77, 20.0), "third road": (11, 20.0), "a minute": (77, 60.0)}
#: Ends of the new specimen's campaign: largest error of a channel, or None for its last playback.
ENDS: Final = {"every channel ≤ 10 %": 0.1, "every channel ≤ 5 %": 0.05, "after all playbacks": None}
_CORRECTIONS: Final = 3
#: A second of the target's beginning and of its end: a drive is at rest there.
_FADE: Final = 1.0
_NEW_NOISE, _WORN_NOISE = 2000, 7000


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds of the longest target, playbacks of a new specimen, targets."""

    longest: float
    playbacks: int
    targets: int


FULL: Final = Extent(60.0, 8, len(TARGETS))
QUICK: Final = Extent(5.0, 2, 1)


@dataclass(frozen=True)
class Ended:
    """Campaign of a new specimen: name of its end and target, playbacks made, the last one."""

    end: str
    target: str
    playbacks: int
    last: Iteration


@dataclass(frozen=True)
class Corrected:
    """Correction after a loss: errors over all channels and of the worst one, noticed and after each playback."""

    ended: Ended
    loss: str
    colour: str
    overall: NDArray[np.float64]
    worst: NDArray[np.float64]


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    ends: list[Ended] = []
    corrected: list[Corrected] = []
    for name, (seed, seconds) in tuple(TARGETS.items())[: extent.targets]:
        target = faded_target(min(seconds, extent.longest), seed=seed)
        found = identify_mapped(NAME, 1.0 / rms(target), level=LEVEL, seconds=75.0, seed=1)
        new = campaign(
            target, found, playing(RIG.changed(), seed=_NEW_NOISE), update=SECANT, playbacks=extent.playbacks
        )
        for end, largest in ENDS.items():
            ended = ended_at(new, largest, end=end, target=name)
            ends.append(ended)
            corrected += [correct(target, found, ended, loss) for loss in range(len(LOSSES))]
    figure, axes = plt.subplots(1, len(ENDS), figsize=(13.5, 4.6), layout="constrained", sharey=True)
    for place, end in zip(axes, ENDS, strict=True):
        draw(place, end, ends, corrected)
    plain_numbers(*axes)
    axes[0].set_yticks((1.0, 2.0, 5.0, 10.0, 20.0, 50.0))
    axes[0].yaxis.set_minor_formatter("")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return Findings(figure, table(ends, corrected))


def faded_target(seconds: float, *, seed: int) -> NDArray[np.float64]:
    """Return responses of the predecessor on a road without potholes, which begin and end at rest."""
    whole = predecessor_target(seconds, potholes=0, road_seed=seed, band=BAND)
    samples = whole.shape[1]
    distance = np.minimum(np.arange(samples), np.arange(samples)[::-1]) / SAMPLE_RATE
    return BAND.limit_target(whole * np.sin(0.5 * np.pi * np.clip(distance / _FADE, 0.0, 1.0)) ** 2)


def playing(condition: Condition, *, seed: int) -> Play:
    """Return a function that plays a drive; each playback has other noise."""
    seeds = iter(range(seed, seed + 100))

    def play(drive: NDArray[np.float64]) -> NDArray[np.float64]:
        playback = RIG.playback(drive, seed=next(seeds), condition=condition)
        for _ in playback.blocks():
            pass
        return playback.response

    return play


def campaign(
    target: NDArray[np.float64],
    found: Identified,
    play: Play,
    *,
    update: UpdateSettings,
    playbacks: int,
    known: KnownBefore = NOTHING_KNOWN,
) -> tuple[Iteration, ...]:
    """Iterate with a drive map; drives beyond the rig's limits are projected to them."""
    steps = iterate(
        play,
        target,
        model=found.learned.model,
        settings=CampaignSettings(
            update=update,
            stop=StopCriteria(iterations=playbacks, **NO_BOUNDS),
            limit_policy=LimitPolicy.PROJECT,
            largest_overrun=LARGEST_OVERRUN,
        ),
        limits=limits_of(RIG),
        drive_map=found.learned.drive_map,
        known=known,
    )
    return tuple(steps)


def ended_at(new: tuple[Iteration, ...], largest: float | None, *, end: str, target: str) -> Ended:
    """Return the campaign up to the first playback whose channels are all accepted; up to the last one otherwise."""
    accepted = [step for step in new if largest is not None and step.metrics.relative_rms_error.max() <= largest]
    last = (accepted or new[-1:])[0]
    return Ended(end, target, last.number, last)


def correct(target: NDArray[np.float64], found: Identified, ended: Ended, number: int) -> Corrected:
    """Play the drive on the worn specimen, and correct it as an endurance test does."""
    name, loss, colour = LOSSES[number]
    play = playing(RIG.changed(loss), seed=_WORN_NOISE)
    noticed = np.asarray(play(ended.last.drive))
    first = FirstDrive(ended.last.drive, noticed, of_this_target=True)
    again = campaign(
        target,
        found,
        play,
        update=update_of_worn(SECANT),
        playbacks=_CORRECTIONS,
        known=KnownBefore(first_drive=first),
    )
    errors = np.array([relative_error(target, noticed), *(step.metrics.relative_rms_error for step in again)])
    return Corrected(ended, name, colour, np.sqrt(np.mean(errors**2, axis=1)), errors.max(axis=1))


def relative_error(target: NDArray[np.float64], response: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative RMS error of each channel in the control band."""
    return np.asarray(rms(BAND.limit_response(response) - target) / rms(target))


def draw(axes: Axes, end: str, ends: list[Ended], corrected: list[Corrected]) -> None:
    """Draw the error over all channels after each playback, and where it was when new."""
    first = ends[0].target
    for each in corrected:
        if each.ended.end == end:
            named = each.loss if each.ended.target == first else None
            axes.semilogy(
                np.arange(each.overall.size), 100.0 * each.overall, marker="o", ms=3.0, color=each.colour, label=named
            )
    for each in ends:
        if each.end == end:
            level = 100.0 * each.last.metrics.overall_relative_rms_error
            named = "new specimen" if each.target == first else None
            axes.axhline(level, color="0.4", linestyle=":", label=named)
    axes.set_xticks(range(_CORRECTIONS + 1))
    label(axes, f"campaign ended: {end}", across="playbacks of the correction", up="error over all channels, %")


def table(ends: list[Ended], corrected: list[Corrected]) -> str:
    """Write the errors when noticed and after the best of the playbacks, and those of the new specimen."""
    head = ["campaign ended, target, playbacks", "new: all channels / worst"]
    head += [f"{name}: noticed → corrected" for name, _, _ in LOSSES]
    rows = []
    for ended in ends:
        metrics = ended.last.metrics
        new = (metrics.overall_relative_rms_error, metrics.relative_rms_error.max())
        row = [f"{ended.end}, {ended.target}, {ended.playbacks}", " / ".join(percent(each) for each in new)]
        for each in corrected:
            if each.ended is ended:
                best = int(np.argmin(each.overall[1:])) + 1
                reached = " / ".join(percent(value) for value in (each.overall[best], each.worst[best]))
                row.append(f"{percent(each.overall[0])} → {reached}")
        rows.append(row)
    return markdown_table(head, rows)


if __name__ == "__main__":
    run("iterating_again", study)
