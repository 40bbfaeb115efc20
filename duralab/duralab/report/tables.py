"""The numbers of the report, ready to print: one row for each channel or actuator, and what is needed to repeat it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

import spectra
from duralab.iteration_table import IterationTable
from duralab.recording import Recording
from duralab.recording_content import ActuatorUse
from duralab.report.identification_words import identification_in_words
from duralab.signals import Channel, Signals
from duralab_proto.v1 import iterator_pb2

_ALGORITHMS = {
    iterator_pb2.UPDATE_KIND_BASIC_TWR: "basic Time Waveform Replication",
    iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING: "Adaptive Modelling",
    iterator_pb2.UPDATE_KIND_SECANT: "secant update",
}


@dataclass(frozen=True)
class ChannelRow:
    """One response channel in the summary; numbers as they are printed."""

    title: str
    target_rms: str
    first_error: str
    best_error: str
    last_error: str
    rms_response: str
    peak_ratio: str
    damage_ratios: str
    accepted: bool | None
    words: str


def channel_rows(table: IterationTable, target: Signals, *, limit: float | None) -> list[ChannelRow]:
    """Return the summary of each channel: first, best and last playback."""
    levels, best = spectra.rms(target.samples), table.best
    rows = []
    for i, channel in enumerate(target.channels):
        error = float(table.relative_rms_error[-1, i])
        watched = bool(table.watched[i])
        accepted = None if limit is None or watched else error <= limit
        rows.append(
            ChannelRow(
                title=channel.title,
                target_rms=f"{levels[i]:,.0f} {channel.unit}" if levels[i] >= 10 else f"{levels[i]:.3g} {channel.unit}",
                first_error=_figure(table.relative_rms_error[0, i]),
                best_error=_figure(table.relative_rms_error[best, i]),
                last_error=_figure(error),
                rms_response=_figure(table.rms_response[-1, i]),
                peak_ratio=_figure(table.peak_ratio[-1, i]),
                damage_ratios=_damage_in_words(table.damage_ratio[-1, i]),
                accepted=accepted,
                words="watched"
                if watched
                else {None: "not judged", True: "accepted", False: "above the limit"}[accepted],
            )
        )
    return rows


def _figure(value: float) -> str:
    """Return a figure, or a dash where there is none: that of a watched channel without a target."""
    return "–" if np.isnan(value) else f"{value:.3f}"


def _damage_in_words(ratios: np.ndarray) -> str:
    """Return the damage ratios of one channel, steepest S-N line last, or a dash where they are not told."""
    return "–" if np.isnan(ratios).any() else " / ".join(f"{ratio:.2f}" for ratio in ratios)


@dataclass(frozen=True)
class RepeatabilityRow:
    """How far one response channel repeats itself; numbers as they are printed, relative to the target's RMS."""

    title: str
    error: str
    noise_floor: str
    systematic_error: str
    words: str


def repeatability_rows(repeatability: iterator_pb2.Repeatability, table: IterationTable) -> list[RepeatabilityRow]:
    """Return the error of the confirmed drive beside the noise floor, a row for each channel."""
    rows = []
    for channel, watched in zip(repeatability.channels, table.watched, strict=True):
        error, floor = channel.relative_rms_error, channel.noise_floor
        if watched:
            words = "watched"
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
class ActuatorRow:
    """The use of one actuator in the last playback."""

    title: str
    limit: str
    peak_percent: float
    saturated: str
    following_error: str


def actuator_rows(uses: Sequence[ActuatorUse], drives: Sequence[Channel]) -> list[ActuatorRow]:
    """Return how each actuator was used."""
    channels = {channel.name: channel for channel in drives}
    return [
        ActuatorRow(
            title=use.drive.replace("_", " "),
            limit=_limits(channels[use.drive]),
            peak_percent=100 * use.peak_command_ratio,
            saturated=f"{100 * use.saturated_share:.2f} %",
            following_error=_length(use.largest_following_error, channels[use.drive].unit),
        )
        for use in uses
        if use.drive in channels
    ]


def _limits(channel: Channel) -> str:
    if channel.minimum == -channel.maximum:
        return f"± {_length(channel.maximum, channel.unit)}"
    return f"{_length(channel.minimum, channel.unit)} to {_length(channel.maximum, channel.unit)}"


def _length(value: float, unit: str) -> str:
    return f"{value * 1000:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"


@dataclass(frozen=True)
class Cell:
    """One element of the FRF matrix: which share of the response's RMS the drive caused, 0 to 1."""

    response: int
    drive: int
    share: float

    @property
    def percent(self) -> str:
        """The share as text."""
        return f"{100 * self.share:.0f}" if np.isfinite(self.share) else "–"

    @property
    def strength(self) -> float:
        """How strongly the cell is coloured, 0 to 1."""
        return float(np.clip(self.share, 0, 1)) if np.isfinite(self.share) else 0.0


def matrix_cells(contributions: np.ndarray) -> list[list[Cell]]:
    """Return the FRF matrix as rows of cells.

    Parameters
    ----------
    contributions : np.ndarray, shape (responses, drives)
        Share of each response's RMS that each drive caused, 0 to 1.

    Returns
    -------
    list of list of Cell
        One row for each response.
    """
    return [
        [Cell(response=i, drive=j, share=float(share)) for j, share in enumerate(row)]
        for i, row in enumerate(contributions)
    ]


def method_in_words(specification: iterator_pb2.CampaignSpec) -> list[tuple[str, str]]:
    """Return what was done, as terms and their values."""
    samples = specification.target.samples.shape
    seconds = samples[1] / specification.target.sample_rate if len(samples) == 2 else 0.0
    stop = specification.stop
    gains = sorted({f"{gain:g}" for gain in np.frombuffer(specification.update.iteration_gain.data, dtype="<f8")})
    return [
        ("Target", f"{specification.target_source}; {seconds:g} s at {specification.target.sample_rate:g} Hz"),
        ("Control band", f"{specification.lowest_frequency:g} to {specification.highest_frequency:g} Hz"),
        ("Identification", identification_in_words(specification.excitation, specification.estimator)),
        ("Update", f"{_ALGORITHMS.get(specification.update.kind, 'unknown')}, gain {', '.join(gains)}"),
        (
            "End",
            f"after {stop.largest_iterations} playbacks"
            + (f", or at a relative RMS error of {stop.relative_rms_error:g}" if stop.relative_rms_error else "")
            + (
                f", with damage ratios of {stop.smallest_damage_ratio:g} to {stop.largest_damage_ratio:g}"
                if stop.largest_damage_ratio
                else ""
            )
            + (f", or when an error exceeds {stop.divergence_ratio:g} × its best" if stop.divergence_ratio else "")
            + (
                f", or when the best error falls by less than {stop.smallest_improvement:.1%}"
                if stop.smallest_improvement
                else ""
            )
            + (f", or before more than {stop.damage_budget:g} × the target's damage" if stop.damage_budget else ""),
        ),
    ]


def provenance(recording: Recording) -> list[tuple[str, str]]:
    """Return seeds, versions and hashes: what is needed to make the same recording again."""
    specification, rig = recording.specification, recording.rig
    rows = [
        ("Campaign", specification.id),
        ("Seed", str(specification.seed)),
        ("Rig", f"{rig.rig}: {rig.specimen}"),
        ("Rig engine", f"{rig.engine} {rig.version}"),
        ("Rig content", f"sha256 {rig.content_hash}"),
        ("Model", f"sha256 {recording.model.id}" if recording.model is not None else "none"),
        ("Recording", f"{recording.path.name}, sha256 {recording.sha256}"),
        ("Report made with", f"duralab {version('duralab')}"),
    ]
    for name, entries in recording.metadata.items():
        rows += [(f"{name}: {key}", value) for key, value in entries.items() if len(value) <= 200]
    return rows
