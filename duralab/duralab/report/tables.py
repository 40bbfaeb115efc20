"""Formatted numbers of the report: one row for each channel, playback or element of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

import duralab_spectra
from duralab.analysis import Comparison
from duralab.campaign import Criterion, Verdict
from duralab.data import DAMAGE_SLOPES, Distortion, IterationTable, Signals, passes
from duralab_proto.v1 import iterator_pb2

Shown = tuple[str, str]
"""Formatted number, and its tone: good, bad, or empty if it is not judged."""


@dataclass(frozen=True)
class ChannelRow:
    """Summary of one response channel of the best playback; numbers with a limit have a tone."""

    title: str
    target_rms: str
    first_error: str
    last_error: str
    error: Shown
    rms_response: str
    peak_ratio: Shown
    damage_ratio: Shown
    energy_outside_band: Shown
    damage_spent: str
    verdict: Shown


_SHORT: Final = {
    Criterion.ERROR: "error",
    Criterion.PEAK: "peak",
    Criterion.DAMAGE: "damage",
    Criterion.OUTSIDE: "energy",
}


def channel_rows(table: IterationTable, target: Signals, *, verdict: Verdict, slope: int) -> list[ChannelRow]:
    """Return the summary of each channel."""
    levels, best = duralab_spectra.rms(target.samples), table.best
    spent = table.damage_spent(slope)[-1]
    damage = table.damage_ratio[best, :, DAMAGE_SLOPES.index(verdict.limits.damage_exponent)]
    rows = []
    for i, (name, channel) in enumerate(zip(table.channels, target.channels, strict=True)):

        def shown(criterion: Criterion, otherwise: str, name: str = name) -> Shown:
            finding = verdict.of(name, criterion)
            return (otherwise, "") if finding is None else (str(finding), "good" if finding.accepted else "bad")

        rows.append(
            ChannelRow(
                title=channel.title,
                target_rms=f"{levels[i]:,.0f} {channel.unit}" if levels[i] >= 10 else f"{levels[i]:.3g} {channel.unit}",
                first_error=_figure(table.relative_rms_error[0, i]),
                last_error=_figure(table.relative_rms_error[-1, i]),
                error=shown(Criterion.ERROR, _figure(table.relative_rms_error[best, i])),
                rms_response=_figure(table.rms_response[best, i]),
                peak_ratio=shown(Criterion.PEAK, _figure(table.peak_ratio[best, i])),
                damage_ratio=shown(Criterion.DAMAGE, _ratio(damage[i])),
                energy_outside_band=shown(Criterion.OUTSIDE, _percent(table.energy_outside_band[i])),
                damage_spent=passes(spent[i]),
                verdict=_channel_verdict(verdict, name, watched=bool(table.watched[i])),
            )
        )
    return rows


def _channel_verdict(verdict: Verdict, name: str, *, watched: bool) -> Shown:
    if watched:
        return ("monitored", "")
    found = [finding for finding in verdict.findings if finding.channel == name]
    failed = [_SHORT[finding.criterion] for finding in found if not finding.accepted]
    if failed:
        return (f"not accepted: {', '.join(failed)}", "bad")
    return ("accepted", "good") if found else ("not judged", "")


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.1f} %"


@dataclass(frozen=True)
class DamageSpentRow:
    """Damage of a playback, or of all playbacks, in each channel, formatted."""

    title: str
    cells: list[str]
    is_sum: bool = False


def damage_spent_rows(table: IterationTable, slope: int) -> list[DamageSpentRow]:
    """Return the damage of identification, each playback, each confirmation and their sum, in passes of the target."""
    identification, _, total = table.damage_spent(slope)
    each = table.playback_damage[:, :, DAMAGE_SLOPES.index(slope)]
    confirmations = range(1, len(each) - len(table) + 1)
    titles = ["identification", *map(str, table.numbers), *(f"confirmation {number}" for number in confirmations)]
    return [
        *(
            DamageSpentRow(title, list(map(passes, row)))
            for title, row in zip(titles, (identification, *each), strict=True)
        ),
        DamageSpentRow("all", list(map(passes, total)), is_sum=True),
    ]


def damage_sum_rows(table: IterationTable) -> list[tuple[int, list[DamageSpentRow]]]:
    """Return the damage of identification, playbacks and their sum for each slope, in passes of the target."""
    titles = ("identification", f"{len(table.playback_damage)} playbacks", "sum")
    return [
        (
            slope,
            [
                DamageSpentRow(title, list(map(passes, row)), is_sum=title == titles[-1])
                for title, row in zip(titles, table.damage_spent(slope), strict=True)
            ],
        )
        for slope in (5, 3, 8)
    ]


def _figure(value: float) -> str:
    """Return a number, or a dash for NaN, as for a monitored channel without a target."""
    return "–" if np.isnan(value) else f"{value:.3f}"


def _damage_in_words(ratios: np.ndarray) -> str:
    """Return the damage ratios of one channel, highest slope last, or a dash if they are not reported."""
    return "–" if np.isnan(ratios).any() else " / ".join(f"{ratio:.2f}" for ratio in ratios)


@dataclass(frozen=True)
class RepeatabilityRow:
    """Repeatability of one response channel, formatted, relative to the target's RMS."""

    title: str
    error: str
    noise_floor: str
    systematic_error: str
    words: str


def repeatability_rows(repeatability: iterator_pb2.Repeatability, table: IterationTable) -> list[RepeatabilityRow]:
    """Return the error of the confirmed drive and the noise floor, a row for each channel."""
    rows = []
    for channel, watched in zip(repeatability.channels, table.watched, strict=True):
        error, floor = channel.relative_rms_error, channel.noise_floor
        if watched:
            words = "monitored"
        elif floor > 0.0:
            words = f"reproduced to within {error / floor:.1f} × of the repeatability"
        else:
            words = "repeats exactly"
        rows.append(
            RepeatabilityRow(
                title=channel.channel.replace("_", " "),
                error=_figure(error),
                noise_floor="–" if np.isnan(floor) else f"{floor:.2g}",
                systematic_error=_figure(channel.systematic_error),
                words=words,
            )
        )
    return rows


@dataclass(frozen=True)
class PlaybackRow:
    """One playback in the full table; `cells` holds (error, response, is the channel's best) of each channel."""

    number: int
    cells: list[tuple[str, str, bool]]
    overall: str
    is_best: bool


def playback_rows(table: IterationTable) -> list[PlaybackRow]:
    """Return the full table of errors."""
    least = table.relative_rms_error.min(axis=0)
    return [
        PlaybackRow(
            number=number,
            cells=[
                (_figure(error), _figure(response), bool(error == least[i]))
                for i, (error, response) in enumerate(
                    zip(table.relative_rms_error[row], table.rms_response[row], strict=True)
                )
            ],
            overall=f"{table.overall[row]:.3f}",
            is_best=row == table.best,
        )
        for row, number in enumerate(table.numbers)
    ]


@dataclass(frozen=True)
class ForecastRow:
    """Prediction before a playback for each channel, formatted.

    `cells`: Predicted error with its uncertainty, and the playback's deviation from its prediction.
    """

    number: int
    cells: list[tuple[str, str]]


def forecast_rows(table: IterationTable) -> list[ForecastRow]:
    """Return the forecasts of the playbacks; empty for an older recording."""
    error, doubt, missed = table.predicted_error, table.prediction_uncertainty, table.prediction_missed
    if error is None or doubt is None or missed is None:
        return []

    def shown(row: int, i: int) -> tuple[str, str]:
        uncertainty = "" if np.isnan(doubt[row, i]) else f" ± {doubt[row, i]:.3f}"
        return _figure(error[row, i]) + uncertainty, _figure(missed[row, i])

    return [
        ForecastRow(number, [shown(row, i) for i in range(len(table.channels))])
        for row, number in enumerate(table.numbers)
    ]


@dataclass(frozen=True)
class Cell:
    """Element of the FRF matrix with the share of the response's RMS that the drive caused, 0 to 1."""

    response: int
    drive: int
    share: float

    @property
    def percent(self) -> str:
        """Share in percent as text."""
        return f"{100 * self.share:.0f}" if np.isfinite(self.share) else "–"

    @property
    def strength(self) -> float:
        """Strength of the cell's colour, 0 to 1."""
        return float(np.clip(self.share, 0, 1)) if np.isfinite(self.share) else 0.0


def matrix_cells(contributions: np.ndarray) -> list[list[Cell]]:
    """Return the FRF matrix as rows of cells."""
    return [
        [Cell(response=i, drive=j, share=float(share)) for j, share in enumerate(row)]
        for i, row in enumerate(contributions)
    ]


@dataclass(frozen=True)
class DamageRow:
    """Formatted damage ratios of one channel: for each slope, one of each shown playback."""

    title: str
    cells: list[list[str]]


def damage_rows(table: IterationTable, playbacks: Sequence[int]) -> list[DamageRow]:
    """Return the damage ratios of each channel after the playbacks with the given rows."""
    return [
        DamageRow(
            title=name.replace("_", " "),
            cells=[
                [_ratio(table.damage_ratio[row, i, column]) for row in playbacks]
                for column in range(len(DAMAGE_SLOPES))
            ],
        )
        for i, name in enumerate(table.channels)
    ]


def _ratio(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


def shares_in_words(found: Distortion, row: int) -> tuple[str, str]:
    """Return the nonlinear share and the noise share of a response's RMS, in percent."""
    return f"{100 * found.distortion_share[row]:.2g} %", f"{100 * found.noise_share[row]:.2g} %"


@dataclass(frozen=True)
class ComparedRow:
    """Formatted channel of a comparison; `cells` has one entry per recording, `least` is the index of the best one."""

    title: str
    cells: list[tuple[str, str, str, str]]
    least: int


def comparison_rows(comparison: Comparison) -> list[ComparedRow]:
    """Return error, peak, damage ratios and damage spent of each channel, for all recordings."""
    rows = []
    for channel in comparison.channels:
        found = comparison.of_channel(channel)
        errors = np.array([row.relative_rms_error for row in found])
        cells = [
            (
                _figure(row.relative_rms_error),
                _figure(row.peak_ratio),
                _damage_in_words(np.array(row.damage_ratio)),
                row.damage_in_words,
            )
            for row in found
        ]
        least = -1 if np.isnan(errors).all() else int(np.nanargmin(errors))
        rows.append(ComparedRow(title=channel.replace("_", " "), cells=cells, least=least))
    return rows
