"""Distance of the best update from the reachable floor: the sensors' noise, and the limits of drives and valves.

`python studies/reachable_floor.py` writes picture and tables of docs/studies/reachable_floor.md again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from low_level_campaigns import BAND, Trial, campaign, identified, limits_of, play, predecessor_target
from low_level_comparison import ADAPTIVE, BASIC_TWR, SECANT, error_after
from matplotlib.axes import Axes
from numpy.typing import NDArray
from rig_cell import responses_of
from studied_rigs import front_axle_compliant
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from iterator import DriveLimits, Iteration, Repeatability, judge_repeatability, judge_response, project_drive
from rig_sim import PlayableRig, load_any_rig, shipped_specimens
from rig_sim.playing import Fault, FaultKind, NoisySensor, ValveSaturation


@dataclass(frozen=True)
class Extent:
    """Extent of the study: road, playbacks, repeats of the best drive, and the values in the tables."""

    seconds: float
    potholes: int
    playbacks: int
    told: tuple[int, ...]
    repeats: int
    noise: tuple[float, ...]
    shares: tuple[float, ...]
    openings: tuple[float, ...]


FULL: Final = Extent(
    16.0, 2, 15, (4, 7, 10), 8, (1.0, 3.0, 10.0, 30.0), (1.0, 0.85, 0.7, 0.55, 0.4), (1.0, 0.5, 0.35, 0.25)
)
QUICK: Final = Extent(4.0, 1, 2, (1, 2), 2, (1.0, 10.0), (1.0, 0.5), (1.0,))
#: Of the operational drive RMS, at which the rig is identified.
SHARE: Final = 0.15
SEED: Final = 1
#: Noise seeds of repeated playbacks, apart from those of campaigns.
_REPEAT_NOISE: Final = 5000
_KINDS: Final = ("vertical", "lateral", "longitudinal")
_BLUE, _GREEN, _RED = SECANT.colour, ADAPTIVE.colour, BASIC_TWR.colour


@dataclass(frozen=True)
class Approach:
    """Campaign, and repeats of its best drive."""

    trial: Trial
    best: Iteration
    repeated: Repeatability


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    other = predecessor_target(extent.seconds, potholes=extent.potholes)
    first = approach(other, extent)
    own = own_target(first.best.drive, extent)
    noisy = {
        name: [first if target is other and times == 1.0 else approach(target, extent, times) for times in extent.noise]
        for name, target in (("another vehicle's", other), ("the rig's own", own))
    }
    limited = [under_limits(other, first.best.drive, share, extent) for share in extent.shares]
    throttled = [throttled_valves(other, opening, extent) for opening in extent.openings]
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 4.8), layout="constrained")
    draw_playbacks(axes[0], noisy)
    draw_noise(axes[1], noisy, extent)
    draw_limits(axes[2], limited, extent)
    tables = (
        noise_table(noisy, extent),
        channels_table(noisy),
        limits_table(limited, extent),
        valves_table(throttled, extent),
    )
    return Findings(figure, "\n\n".join(tables))


@cache
def rig_with_noise(times: float) -> PlayableRig:
    """Return the rig with its sensors' noise multiplied by a factor."""
    rig = front_axle_compliant().rig
    if times == 1.0:
        return rig
    added = np.sqrt(times**2 - 1.0)
    return _broken(
        [
            NoisySensor(kind=FaultKind.NOISY_SENSOR, channel=channel.name, rms=float(added * channel.noise_rms))
            for channel in rig.specimen.responses
        ]
    )


def approach(target: NDArray[np.float64], extent: Extent, times: float = 1.0) -> Approach:
    """Iterate with the secant update, then repeat its best drive."""
    rig = rig_with_noise(times)
    trial = _iterated(target, extent, rig=rig, projected_to=limits_of(rig))
    best = trial.iterations[int(np.argmin(trial.overall))]
    return Approach(trial, best, judge_repeatability(target, repeats(rig, best.drive, extent)))


def repeats(rig: PlayableRig, drive: NDArray[np.float64], extent: Extent) -> list[NDArray[np.float64]]:
    """Play a drive several times, with other noise each time."""
    playbacks = [rig.playback(drive, seed=_REPEAT_NOISE + number) for number in range(extent.repeats)]
    return [BAND.limit_response(response) for response in responses_of(playbacks)]


def own_target(drive: NDArray[np.float64], extent: Extent) -> NDArray[np.float64]:
    """Return what the rig itself does with a drive, so that there is one that reaches it: mean of several playbacks."""
    return np.mean(repeats(front_axle_compliant().rig, drive, extent), axis=0)


@dataclass(frozen=True)
class Limited:
    """Under limits: error of the unlimited drive carried into them, and of a campaign that knows them."""

    share: float
    carried_error: float
    trial: Trial
    saturated: float
    elsewhere: float


def under_limits(target: NDArray[np.float64], drive: NDArray[np.float64], share: float, extent: Extent) -> Limited:
    """Iterate under limits that leave a share of each channel's largest drive."""
    rig = front_axle_compliant().rig
    peak = share * np.abs(drive).max(axis=1)
    limits = replace(limits_of(rig), minimum=-peak, maximum=peak)
    carried = project_drive(drive, limits=limits, band=BAND).drive
    response = BAND.limit_response(play(rig, carried, seed=_REPEAT_NOISE))
    trial = _iterated(target, extent, rig=rig, projected_to=limits)
    best = trial.iterations[int(np.argmin(trial.overall))]
    held = best.projection.saturated if best.projection is not None else np.zeros_like(best.drive, dtype=bool)
    return Limited(
        share,
        judge_response(target, response).overall_relative_rms_error,
        trial,
        float(held.any(axis=0).mean()),
        _error_elsewhere(target, best),
    )


def _error_elsewhere(target: NDArray[np.float64], best: Iteration) -> float:
    """Error over all channels in the time that is not flagged as beyond reach, over the whole target's RMS."""
    left = np.ones(target.shape, dtype=bool)
    for flagged in best.unreachable:
        start, end = (round(at * BAND.sample_rate) for at in (flagged.segment.start, flagged.segment.end))
        left[flagged.response, start:end] = False
    missed = (target - best.response_in_band) ** 2
    power = np.array([missed[row, left[row]].mean() for row in range(target.shape[0]) if left[row].any()])
    level = np.array([np.mean(target[row] ** 2) for row in range(target.shape[0]) if left[row].any()])
    return float(np.sqrt(np.mean(power / level)))


@dataclass(frozen=True)
class Throttled:
    """With valves that open less: how long they were at their stop in the last playback, and the campaign."""

    opening: float
    saturated: dict[str, float]
    trial: Trial


def throttled_valves(target: NDArray[np.float64], opening: float, extent: Extent) -> Throttled:
    """Iterate with valve limits that are not in the drives' limits."""
    rig = front_axle_compliant().rig
    if opening < 1.0:
        rig = _broken(
            [ValveSaturation(kind=FaultKind.VALVE_SATURATION, actuator_kind=kind, opening=opening) for kind in _KINDS]
        )
    trial = _iterated(target, extent, rig=rig, projected_to=limits_of(rig))
    played = rig.playback(trial.iterations[-1].drive, seed=_REPEAT_NOISE)
    for _ in played.blocks():
        pass
    found: dict[str, float] = {}
    for use in played.uses():
        kind = use.drive.partition("_")[2]
        found[kind] = max(found.get(kind, 0.0), use.saturated_share)
    return Throttled(opening, found, trial)


def _broken(faults: Sequence[Fault]) -> PlayableRig:
    name = front_axle_compliant().rig.specimen.name
    return load_any_rig(shipped_specimens()[name], faults={name: faults})


def _iterated(target: NDArray[np.float64], extent: Extent, *, rig: PlayableRig, projected_to: DriveLimits) -> Trial:
    return campaign(
        target,
        model=identified(SHARE, SEED),
        update=SECANT.settings,
        playbacks=extent.playbacks,
        rig=rig,
        projected_to=projected_to,
    )


def _overall(of_channels: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(of_channels**2)))


def draw_playbacks(axes: Axes, noisy: dict[str, list[Approach]]) -> None:
    """Draw error over playbacks for both targets at the rig's own noise, with the floor."""
    for (name, found), colour in zip(noisy.items(), (_RED, _BLUE), strict=True):
        errors = 100.0 * found[0].trial.overall
        axes.semilogy(np.arange(1, errors.size + 1), errors, "o-", ms=3.5, color=colour, label=f"{name} target")
    # The noise is the sensors', so the floor of both targets is one.
    floor = 100.0 * _overall(next(iter(noisy.values()))[0].repeated.noise_floor)
    axes.axhline(floor, color="0.3", ls=":", lw=1.0, label="noise floor")
    label(axes, "the rig's own noise", across="playback", up="relative RMS error, all channels, %")
    plain_numbers(axes)
    axes.legend(loc="best")


def draw_noise(axes: Axes, noisy: dict[str, list[Approach]], extent: Extent) -> None:
    """Draw error of the best drive over the sensors' noise."""
    for (name, found), colour in zip(noisy.items(), (_RED, _BLUE), strict=True):
        errors = [100.0 * _overall(each.repeated.relative_rms_error) for each in found]
        left = [100.0 * _overall(each.repeated.systematic_error) for each in found]
        axes.loglog(extent.noise, errors, "o-", ms=4, color=colour, label=f"{name} target")
        axes.loglog(extent.noise, left, "s--", ms=3.5, color=colour, label="without the noise")
    floor = [100.0 * _overall(each.repeated.noise_floor) for each in next(iter(noisy.values()))]
    axes.loglog(extent.noise, floor, ":", color="0.3", label="noise floor")
    axes.set_xticks(extent.noise, [f"{times:g}" for times in extent.noise])
    axes.minorticks_off()
    plain_numbers(axes)
    label(axes, "best drive, repeated", across="noise, times the rig's own", up="relative RMS error, all channels, %")
    axes.legend(loc="best")


def draw_limits(axes: Axes, limited: list[Limited], extent: Extent) -> None:
    """Draw error over the limits' share of the largest drive."""
    shares = [100.0 * each.share for each in limited]
    lines = (
        ("the unlimited drive, carried into the limits", _RED, [each.carried_error for each in limited]),
        (f"best of {extent.playbacks} playbacks", _BLUE, [each.trial.overall.min() for each in limited]),
        ("the same, outside flagged stretches", _GREEN, [each.elsewhere for each in limited]),
    )
    for name, colour, errors in lines:
        axes.semilogy(shares, 100.0 * np.asarray(errors), "o-", ms=4, color=colour, label=name)
    plain_numbers(axes)
    across = "limit, % of the largest value of the unlimited drive"
    label(axes, "limits of the drives", across=across, up="relative RMS error, all channels, %")
    axes.invert_xaxis()
    axes.set_ylim(bottom=0.4)
    axes.legend(loc="lower right")


def noise_table(noisy: dict[str, list[Approach]], extent: Extent) -> str:
    """Write errors and floors for every target and noise."""
    head = ["target, noise", *(f"after {number}" for number in extent.told), "best", "in playback"]
    head += ["best drive repeated", "noise floor", "without the noise"]
    rows = []
    for name, found in noisy.items():
        for times, each in zip(extent.noise, found, strict=True):
            row = [f"{name}, {times:g} times", *(error_after(each.trial, n) for n in extent.told)]
            row += [percent(float(each.trial.overall.min())), str(each.best.number)]
            row += [
                percent(_overall(of_channels))
                for of_channels in (
                    each.repeated.relative_rms_error,
                    each.repeated.noise_floor,
                    each.repeated.systematic_error,
                )
            ]
            rows.append(row)
    return markdown_table(head, rows)


def channels_table(noisy: dict[str, list[Approach]]) -> str:
    """Write for every response what the best drive leaves, at the rig's own noise."""
    names = [channel.name.replace("_", " ") for channel in front_axle_compliant().rig.specimen.responses]
    rows = []
    for name, found in noisy.items():
        repeated = found[0].repeated
        rows.append([f"{name} target: error", *(percent(float(value)) for value in repeated.relative_rms_error)])
        rows.append(["noise floor", *(percent(float(value)) for value in repeated.noise_floor)])
    return markdown_table(["best drive repeated, the rig's own noise", *names], rows)


def limits_table(limited: list[Limited], extent: Extent) -> str:
    """Write what limits of the drives leave."""
    head = ["limits, of the largest drive", "unlimited drive carried into them", f"best of {extent.playbacks}"]
    head += ["last", "a drive held, of the time", "error outside flagged stretches"]
    rows = [
        [
            f"{100.0 * each.share:g} %",
            percent(each.carried_error),
            percent(float(each.trial.overall.min())),
            each.trial.stopped or percent(float(each.trial.overall[-1])),
            percent(each.saturated),
            percent(each.elsewhere),
        ]
        for each in limited
    ]
    return markdown_table(head, rows)


def valves_table(throttled: list[Throttled], extent: Extent) -> str:
    """Write what valves leave that open less."""
    head = ["valves open to", *(f"{kind} valve at its stop, of the time" for kind in _KINDS)]
    head += [f"best of {extent.playbacks}", "last"]
    rows = [
        [
            f"{100.0 * each.opening:g} %",
            *(percent(each.saturated[kind]) if each.saturated.get(kind) else "never" for kind in _KINDS),
            percent(float(each.trial.overall.min())),
            each.trial.stopped or percent(float(each.trial.overall[-1])),
        ]
        for each in throttled
    ]
    return markdown_table(head, rows)


if __name__ == "__main__":
    run("reachable_floor", study)
