"""Numbers of a campaign: one row for each playback, one column for each response channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.display import Axis, Curve, html_table, line_chart, text_table
from duralab_proto.v1 import iterator_pb2

if TYPE_CHECKING:
    import xarray

_ITERATIONS: Final = "relative RMS error (RMS response), 0 (1) is perfect"

DAMAGE_SLOPES: Final = (3, 5, 8)
"""Slopes of the S-N lines of damage ratios, in the order of the contract."""

DAMAGE_SPENT_SLOPE: Final = 5
"""Default slope of the S-N line for the damage spent."""


@dataclass(frozen=True, eq=False)
class IterationTable:
    """Numbers of every playback, in the control band.

    Parameters
    ----------
    channels : tuple of str
        Names of the responses, in the rig's order.
    numbers : tuple of int
        Number of each playback, from 1.
    relative_rms_error : np.ndarray, shape (playbacks, channels)
        rms(target - response) / rms(target).
    rms_response : np.ndarray, shape (playbacks, channels)
        rms(response) / rms(target).
    peak_ratio : np.ndarray, shape (playbacks, channels)
        Largest magnitude of the response over that of the target.
    damage_ratio : np.ndarray, shape (playbacks, channels, 3)
        Pseudo-damage of the response over that of the target, for S-N lines of slope 3, 5 and 8; NaN if an older
        recording does not contain it.
    overall : np.ndarray, shape (playbacks)
        Root mean square over the judged channels of the relative RMS error.
    level : np.ndarray, shape (playbacks)
        Level of the playback as a share of the target, to which all numbers are relative; 1 is the whole target.
    watched : np.ndarray of bool, shape (channels)
        True for a monitored channel, which is reported, but neither controlled nor judged; its numbers are NaN if its
        target is zero.
    energy_outside_band : np.ndarray, shape (channels)
        Share of the energy of the target's dynamic part outside the control band, 0 to 1; NaN in an older recording.
    best_number : int
        Number of the iterator's best playback; 0 if it has none, see `best`.
    playback_damage : np.ndarray, shape (playbacks + confirmations, channels, 3)
        Damage of each playback, and then of each confirmation, in each channel of the specimen, in passes of the
        target, for S-N lines of slope 3, 5 and 8: damage of the measured response, regardless of the control band,
        over that of the target in the band; at least the damage of the target at the playback's level.
    damage_as_measured : bool
        Whether `playback_damage` is of the measured response; False for an older recording, which states only the
        response in the band.
    identification_damage : np.ndarray, shape (channels, 3)
        Damage of the identification, in the same form; NaN if the recording does not state it.
    predicted_error : np.ndarray, shape (playbacks, channels), optional
        Relative RMS error predicted before each playback. NaN for a monitored channel; None, as the next two, in an
        older recording.
    prediction_uncertainty : np.ndarray, shape (playbacks, channels), optional
        RMS of the uncertainty predicted before each playback, over the target's RMS.
    prediction_missed : np.ndarray, shape (playbacks, channels), optional
        RMS of the measured difference from the prediction, over the target's RMS.
    """

    channels: tuple[str, ...]
    numbers: tuple[int, ...]
    relative_rms_error: np.ndarray
    rms_response: np.ndarray
    peak_ratio: np.ndarray
    damage_ratio: np.ndarray
    overall: np.ndarray
    level: np.ndarray
    watched: np.ndarray
    energy_outside_band: np.ndarray
    best_number: int
    playback_damage: np.ndarray
    damage_as_measured: bool
    identification_damage: np.ndarray
    predicted_error: np.ndarray | None = None
    prediction_uncertainty: np.ndarray | None = None
    prediction_missed: np.ndarray | None = None

    @classmethod
    def from_messages(
        cls,
        iterations: Sequence[iterator_pb2.IterationMetrics],
        *,
        confirmations: Sequence[iterator_pb2.IterationMetrics] = (),
        status: iterator_pb2.CampaignStatus | None = None,
    ) -> IterationTable:
        """Decode the metrics of a campaign; an empty sequence gives an empty table.

        Parameters
        ----------
        iterations, confirmations : sequence of IterationMetrics
            Metrics of the playbacks of the iteration, and of those that confirm its best drive.
        status : CampaignStatus, optional
            Status with the number of the best playback.

        Raises
        ------
        ValueError
            A playback has channels different from the first.
        """
        names = tuple(channel.channel for channel in iterations[0].channels) if iterations else ()
        for metrics in (*iterations, *confirmations):
            if tuple(channel.channel for channel in metrics.channels) != names:
                raise ValueError(f"Playback {metrics.iteration} has other channels than the first, {', '.join(names)}.")

        def column(name: str) -> np.ndarray:
            rows = [[getattr(channel, name) for channel in metrics.channels] for metrics in iterations]
            return np.array(rows, dtype=np.float64).reshape(len(iterations), len(names))

        return cls(
            channels=names,
            numbers=tuple(metrics.iteration for metrics in iterations),
            relative_rms_error=column("relative_rms_error"),
            rms_response=column("rms_response"),
            peak_ratio=column("peak_ratio"),
            damage_ratio=_by_slope(iterations, "damage_ratio", channels=len(names)),
            overall=np.array([metrics.overall_relative_rms_error for metrics in iterations], dtype=np.float64),
            # Recordings older than levels contain 0.
            level=np.array([metrics.level or 1.0 for metrics in iterations], dtype=np.float64),
            # From the last playback: one taken over from another campaign may have been judged differently.
            watched=np.array(
                [channel.watched for channel in iterations[-1].channels] if iterations else [], dtype=bool
            ),
            energy_outside_band=np.array(
                [
                    channel.target_energy_outside_band if channel.HasField("target_energy_outside_band") else np.nan
                    for channel in (iterations[-1].channels if iterations else ())
                ]
            ),
            best_number=_best_number(iterations, status),
            playback_damage=np.concatenate(
                [_playback_damage(playbacks, channels=len(names)) for playbacks in (iterations, confirmations)]
            ),
            damage_as_measured=all(
                channel.specimen_damage for metrics in (*iterations, *confirmations) for channel in metrics.channels
            ),
            identification_damage=_by_slope(iterations[-1:], "identification_damage", channels=len(names)).sum(axis=0)
            if iterations
            else np.zeros((0, len(DAMAGE_SLOPES))),
            predicted_error=_forecast(iterations, "relative_rms_error"),
            prediction_uncertainty=_forecast(iterations, "uncertainty"),
            prediction_missed=_forecast(iterations, "missed"),
        )

    @classmethod
    def from_status(cls, status: iterator_pb2.CampaignStatus) -> IterationTable:
        """Decode the numbers of a campaign from its status.

        Parameters
        ----------
        status : CampaignStatus
            Status of a campaign, which may still run.

        Returns
        -------
        IterationTable
            Table with the confirmations and the best playback; empty before the first playback.
        """
        return cls.from_messages(status.iterations, confirmations=status.confirmations, status=status)

    def __len__(self) -> int:
        """Return the number of playbacks."""
        return len(self.numbers)

    @property
    def judged_error(self) -> np.ndarray:
        """Relative RMS error of the judged channels, shape (playbacks, judged)."""
        return self.relative_rms_error[:, ~self.watched]

    @property
    def judged(self) -> tuple[str, ...]:
        """Names of the judged channels: all except the monitored ones."""
        return tuple(name for name, watched in zip(self.channels, self.watched, strict=True) if not watched)

    @property
    def best(self) -> int:
        """Row of the best playback, which is judged, exported and confirmed; the table must not be empty.

        The iterator chooses it: the last playback if the target was reached, otherwise the playback of the whole target
        with the smallest error over all channels. Before its choice: the latter, also among playbacks at a lower level
        if there is none of the whole target.
        """
        if self.best_number in self.numbers:
            return self.numbers.index(self.best_number)
        whole = self.level == 1.0
        return int(np.argmin(np.where(whole, self.overall, np.inf) if whole.any() else self.overall))

    def damage_spent(self, slope: int = DAMAGE_SPENT_SLOPE) -> np.ndarray:
        """Return the campaign's damage in each channel of the specimen, in passes of the target.

        It is counted as in the iterator's damage budget. Interrupted runs are not counted.

        Parameters
        ----------
        slope : int
            Slope of the S-N line: 3, 5 or 8.

        Returns
        -------
        np.ndarray, shape (3, channels)
            Damage of the identification, of all playbacks and confirmations, and their sum. If `counts_identification`
            is False, the first is NaN and the sum is that of the playbacks; all are NaN for a channel without a target.

        Raises
        ------
        ValueError
            The slope is not 3, 5 or 8.
        """
        column = DAMAGE_SLOPES.index(slope)
        identification = self.identification_damage[:, column]
        playbacks = self.playback_damage[:, :, column].sum(axis=0)
        return np.array((identification, playbacks, playbacks + np.nan_to_num(identification)))

    @property
    def counts_identification(self) -> bool:
        """Whether the damage of the identification is known; an older recording does not state it."""
        return not bool(np.isnan(self.identification_damage[~self.watched]).any())

    def to_xarray(self) -> xarray.Dataset:
        """Return the numbers over `iteration`, `channel` and `slope` (of the S-N line); all are ratios."""
        import xarray

        forecast = {
            name: (("iteration", "channel"), figures, {"units": "1"})
            for name in ("predicted_error", "prediction_uncertainty", "prediction_missed")
            if (figures := getattr(self, name)) is not None
        }
        return xarray.Dataset(
            {
                "relative_rms_error": (("iteration", "channel"), self.relative_rms_error, {"units": "1"}),
                "rms_response": (("iteration", "channel"), self.rms_response, {"units": "1"}),
                "peak_ratio": (("iteration", "channel"), self.peak_ratio, {"units": "1"}),
                "damage_ratio": (("iteration", "channel", "slope"), self.damage_ratio, {"units": "1"}),
                "playback_damage": (
                    ("iteration", "channel", "slope"),
                    self.playback_damage[: len(self)],
                    {"units": "1"},
                ),
                "identification_damage": (("channel", "slope"), self.identification_damage, {"units": "1"}),
                "overall": (("iteration",), self.overall, {"units": "1"}),
                "level": (("iteration",), self.level, {"units": "1"}),
                "energy_outside_band": (("channel",), self.energy_outside_band, {"units": "1"}),
                **forecast,
            },
            coords={"iteration": list(self.numbers), "channel": list(self.channels), "slope": list(DAMAGE_SLOPES)},
        )

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"IterationTable({len(self)} playbacks, {len(self.channels)} channels)"

    def __str__(self) -> str:
        """Return the table as text: relative RMS error (RMS response) for each playback and channel."""
        return iterations_text(self)

    def _repr_html_(self) -> str:

        return iterations_html(self)

    def cells(self, row: int) -> list[str]:
        """Return error and response of one playback for each channel, as text.

        Parameters
        ----------
        row : int
            Row of the table, from 0.

        Returns
        -------
        list of str
            Cells, one for each channel.
        """
        pairs = zip(self.relative_rms_error[row], self.rms_response[row], strict=True)
        return ["–" if np.isnan(error) else f"{error:.3f} ({response:.2f})" for error, response in pairs]


def counted_slope(specification: iterator_pb2.CampaignSpec) -> int:
    """Return the slope of the S-N line for a campaign's damage spent, as in its damage budget.

    `specification`: Specification of the campaign.
    Returns: Slope of the S-N line: 3, 5 or 8.
    """
    asked = specification.stop.damage_exponent
    return int(asked) if asked in DAMAGE_SLOPES else DAMAGE_SPENT_SLOPE


def _by_slope(playbacks: Sequence[iterator_pb2.IterationMetrics], name: str, *, channels: int) -> np.ndarray:
    """Return a quantity of each playback and channel for every slope; NaN if the recording does not have it."""
    figures = np.full((len(playbacks), channels, len(DAMAGE_SLOPES)), np.nan)
    for row, metrics in enumerate(playbacks):
        for i, channel in enumerate(metrics.channels):
            values = getattr(channel, name)
            if len(values) == len(DAMAGE_SLOPES):
                figures[row, i] = values
    return figures


def _playback_damage(playbacks: Sequence[iterator_pb2.IterationMetrics], *, channels: int) -> np.ndarray:
    stated = _by_slope(playbacks, "specimen_damage", channels=channels)
    # Older recordings state only the response in the band; the target at its level is the minimum, as it was then.
    ratios = _by_slope(playbacks, "damage_ratio", channels=channels)
    level = np.array([metrics.level or 1.0 for metrics in playbacks])[:, np.newaxis, np.newaxis]
    in_band = np.maximum(1.0, ratios) * level ** np.array(DAMAGE_SLOPES)
    return np.where(np.isnan(stated), in_band, stated)


def _forecast(playbacks: Sequence[iterator_pb2.IterationMetrics], name: str) -> np.ndarray | None:
    """Return a quantity of the forecasts, shape (playbacks, channels); None if no playback has a forecast."""
    rows = [
        [getattr(channel.forecast, name) if channel.HasField("forecast") else np.nan for channel in metrics.channels]
        for metrics in playbacks
    ]
    known = any(channel.HasField("forecast") for metrics in playbacks for channel in metrics.channels)
    return np.array(rows) if known else None


def _best_number(
    iterations: Sequence[iterator_pb2.IterationMetrics], status: iterator_pb2.CampaignStatus | None
) -> int:
    """Return the number of the best playback from the status; 0 if it has none."""
    if status is None or not iterations:
        return 0
    # An older iterator reported the smallest overall error here, though only the last playback meets all criteria.
    reached = status.outcome == iterator_pb2.OUTCOME_REACHED
    return iterations[-1].iteration if reached else status.best_iteration


def _iteration_rows(table: IterationTable) -> tuple[list[str], list[list[str]]]:
    marks = (" (monitored)" if watched else "" for watched in table.watched)
    names = (f"{name.replace('_', ' ')}{mark}" for name, mark in zip(table.channels, marks, strict=True))
    rows = [[str(number), *table.cells(row), f"{table.overall[row]:.3f}"] for row, number in enumerate(table.numbers)]
    if len(table):
        for source, spent in zip(damage_sources(table), table.damage_spent(), strict=True):
            rows.append([f"{source} (k = {DAMAGE_SPENT_SLOPE})", *map(passes, spent), "passes"])
    return ["playback", *names, "overall"], rows


def passes(damage: float) -> str:
    """Return damage spent in passes of the target as text; a dash if it is unknown.

    `damage`: Damage in passes of the target, 0 or more; NaN if unknown.
    Returns: The number as text.
    """
    if np.isnan(damage):
        return "–"
    if 0.0 < damage < 0.1:
        return "< 0.1"
    return f"{damage:.1f}" if damage < 100 else f"{float(f'{damage:.3g}'):,.0f}"


def damage_sources(table: IterationTable) -> tuple[str, str, str]:
    """Return the titles of the rows of `damage_spent`.

    `table`: Table, whose `counts_identification` decides on the last title.
    Returns: Titles for the identification, for the playbacks, and for their sum.
    """
    total = "damage spent" if table.counts_identification else "damage spent, without identification"
    return "damage of identification", "damage of playbacks", total


def damage_note(table: IterationTable) -> str:
    """Return sentences that explain damage spent and its unknown parts.

    `table`: Numbers of one or more playbacks.
    Returns: Two sentences or more.
    """
    counted = "as measured, inside and outside the control band" if table.damage_as_measured else "in the control band"
    sentences = [
        f"Damage spent: pseudo-damage of each response {counted}, over that of the target counted alike.",
        "A playback counts as the target at its level at least.",
    ]
    if not table.counts_identification:
        sentences.append("The recording does not state the damage of the identification, so that is not counted.")
    if np.isnan(table.playback_damage).any():
        sentences.append("–: no target, or not stated.")
    return " ".join(sentences)


def iterations_text(table: IterationTable) -> str:
    """Return error and RMS response of each playback and channel as text."""
    note = f"\n{damage_note(table)}" if len(table) else ""
    return f"{_ITERATIONS}\n{text_table(*_iteration_rows(table))}{note}"


def iterations_html(table: IterationTable) -> str:
    """Return the numbers as HTML, with the error over the playbacks.

    `table`: Numbers of the playbacks; may be empty.
    Returns: An HTML table and a chart.
    """
    if not len(table):
        return "<p>No playback yet.</p>"
    numbers = np.array(table.numbers, dtype=np.float64)
    curves = [
        Curve(name.replace("_", " "), numbers, column)
        for name, column in zip(table.channels, table.relative_rms_error.T, strict=True)
    ]
    chart = line_chart(curves, x=Axis("playback"), y=Axis("relative RMS error"), from_zero=True)
    return f"{html_table(*_iteration_rows(table), caption=_ITERATIONS)}<p>{escape(damage_note(table))}</p>{chart}"
