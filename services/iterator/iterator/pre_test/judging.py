"""Judgement of a pre-test: figures of every channel, and findings on faults."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from iterator.pre_test.expectation import Expectation, in_windows, smoothed, within
from iterator.pre_test.matching import Match, match_channels
from iterator.pre_test.pulses import PulseTrain

NOISE_SHARE: Final = 0.01
"""Largest RMS at rest over the range of the sensor. Shipped rigs have 0.0002."""

OFFSET_SHARE: Final = 0.02
"""Largest difference of the mean at rest from the static response, over the range of the sensor."""

SIGNIFICANT: Final = 6.0
"""Smallest peak over the RMS at rest of a response that has moved: white noise has 4 in the window of a pulse."""

# Noise floor of a channel without noise: smaller shares of its range are rounding.
_SMALLEST_NOISE: Final = 1e-8
# Share of the range: a sensor this near the end of its range is at its end.
_AT_THE_END: Final = 0.001
# Duration of equal samples at the extreme of a response that is longer than in a smooth peak.
_FLAT_SECONDS: Final = 0.01
_FLAT_SAMPLES: Final = 5
# Share of its peak at which a channel's rise is detected.
_RISE: Final = 0.2
_LARGEST_LAG: Final = 0.005
_LAG_SAMPLES: Final = 3
_SEARCHED_LAG: Final = 0.05
# A worn specimen changes a gain by less than the first factor; a wrong unit by more than the second.
_LARGEST_GAIN: Final = 2.0
_WRONG_GAIN: Final = 5.0
# Smallest effect of the drive in the sensor table, over that of the drive with the largest effect.
_NAMED_SHARE: Final = 0.2
_CLEAR: Final = 0.5
_UNLIKE: Final = 0.25


class Check(Enum):
    """Check of a pre-test; the values are the names of the contract."""

    CALIBRATION = "PRE_TEST_CHECK_CALIBRATION"
    NOISE = "PRE_TEST_CHECK_NOISE"
    OFFSET = "PRE_TEST_CHECK_OFFSET"
    SATURATION = "PRE_TEST_CHECK_SATURATION"
    DEAD = "PRE_TEST_CHECK_DEAD"
    POLARITY = "PRE_TEST_CHECK_POLARITY"
    SWAPPED = "PRE_TEST_CHECK_SWAPPED"
    CROSS_TALK = "PRE_TEST_CHECK_CROSS_TALK"
    LAG = "PRE_TEST_CHECK_LAG"
    GAIN = "PRE_TEST_CHECK_GAIN"


@dataclass(frozen=True)
class Finding:
    """Finding about some channels, in one sentence: a failure or a remark."""

    check: Check
    channels: tuple[str, ...]
    sentence: str
    failed: bool = True


@dataclass(frozen=True)
class ResponseChannel:
    """Description of a response: range and static response in its unit, polarity 1, -1 or 0, and its drive."""

    name: str
    unit: str
    minimum: float
    maximum: float
    static: float = 0.0
    polarity: int = 0
    drive: str = ""

    @property
    def range(self) -> float:
        """Largest magnitude that the sensor measures."""
        return max(abs(self.minimum), abs(self.maximum))


@dataclass(frozen=True)
class Drive:
    """A drive, and whether it has an effect while all others are at zero, as a displacement or force has."""

    name: str
    moves_alone: bool = True
    saturated_share: float = 0.0


@dataclass(frozen=True)
class Judgement:
    """Figures by channel in the order of the rig, see the message `PreTest`, and the findings."""

    offset: NDArray[np.float64]
    noise: NDArray[np.float64]
    peak: NDArray[np.float64]
    lag: NDArray[np.float64]
    gain: NDArray[np.float64]
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether there is no failure."""
        return not any(finding.failed for finding in self.findings)


def judge(
    train: PulseTrain,
    response: NDArray[np.float64],
    *,
    drives: Sequence[Drive],
    responses: Sequence[ResponseChannel],
    sample_rate: float,
    expected: Expectation | None = None,
) -> Judgement:
    """Judge the responses, shape (responses, samples), to a pulse train."""
    rest = response[:, : train.rest].mean(axis=1)
    noise = response[:, : train.rest].std(axis=1)
    ranges = np.array([channel.range for channel in responses])
    moved = smoothed(response - rest[:, None], sample_rate)
    floor = np.maximum(moved[:, : train.rest].std(axis=1), _SMALLEST_NOISE * ranges)
    peak = np.abs(in_windows(moved, train)).max(axis=2)
    record = _Record(train, response, moved, peak, floor, drives, responses, sample_rate)
    offset = rest - np.array([channel.static for channel in responses])
    findings = [*_noise(record, noise), *_offset(record, offset), *_saturation(record, rest)]
    lag, gain = record.lag_behind_drives(), np.full(len(responses), np.nan)
    wanted = None if expected is None else smoothed(expected.response, sample_rate)
    findings += _dead(
        record, wanted, {name for one in findings for name in one.channels if one.check is not Check.OFFSET}
    )
    if expected is not None and wanted is not None:
        measured = within(expected.band, in_windows(moved, train), sample_rate)
        match = match_channels(measured, wanted, amplitude=train.amplitude, floor=SIGNIFICANT * floor)
        findings += _matched(record, match)
        lag, gain = _lag_and_gain(record, measured, wanted, match)
        findings += [*_lags(record, lag), *_gains(record, gain)]
    findings += _against_table(record, findings)
    return Judgement(offset, noise, peak, lag, gain, tuple(findings))


@dataclass(frozen=True)
class _Record:
    train: PulseTrain
    response: NDArray[np.float64]
    moved: NDArray[np.float64]
    peak: NDArray[np.float64]
    floor: NDArray[np.float64]
    drives: Sequence[Drive]
    responses: Sequence[ResponseChannel]
    sample_rate: float

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Significance of each response to each pulse, shape (responses, drives)."""
        return self.peak > SIGNIFICANT * self.floor[:, None]

    def lag_behind_drives(self) -> NDArray[np.float64]:
        """Return the lag in s of each response behind its strongest drive, from the rise of both."""
        lags = np.full(len(self.responses), np.nan)
        for row, strongest in enumerate(self.peak.argmax(axis=1)):
            if self.significant[row, strongest]:
                window = self.train.windows[strongest]
                answer = np.abs(self.moved[row, window])
                pulse = np.abs(smoothed(self.train.drive[strongest : strongest + 1], self.sample_rate)[0, window])
                # The pulse of the two with the larger effect.
                slow = self.train.slow
                one = slice(0, slow) if answer.argmax() < slow else slice(slow, None)
                rises = [int(np.argmax(each >= _RISE * each.max())) for each in (answer[one], pulse[one])]
                lags[row] = (rises[0] - rises[1]) / self.sample_rate
        return lags


def _noise(record: _Record, noise: NDArray[np.float64]) -> list[Finding]:
    return [
        Finding(
            Check.NOISE,
            (channel.name,),
            f"{channel.name} has a noise of {rms:.3g} {channel.unit} RMS at rest, {100 * rms / channel.range:.1f} % "
            f"of its range; {100 * NOISE_SHARE:.0f} % is allowed: look at cable, shield and amplifier.",
        )
        for channel, rms in zip(record.responses, noise, strict=True)
        if rms > NOISE_SHARE * channel.range
    ]


def _offset(record: _Record, offset: NDArray[np.float64]) -> list[Finding]:
    return [
        Finding(
            Check.OFFSET,
            (channel.name,),
            f"{channel.name} is {value:.4g} {channel.unit} away from its static response of {channel.static:.4g} "
            f"{channel.unit} at rest, {100 * abs(value) / channel.range:.1f} % of its range; "
            f"{100 * OFFSET_SHARE:.0f} % is allowed: "
            "zero it, or correct the static response.",
        )
        for channel, value in zip(record.responses, offset, strict=True)
        if abs(value) > OFFSET_SHARE * channel.range
    ]


def _saturation(record: _Record, rest: NDArray[np.float64]) -> list[Finding]:
    findings = []
    shortest = max(_FLAT_SAMPLES, round(_FLAT_SECONDS * record.sample_rate))
    for row, channel in enumerate(record.responses):
        values, near = record.response[row], _AT_THE_END * channel.range
        largest, smallest = float(values.max()), float(values.min())
        if largest >= channel.maximum - near or smallest <= channel.minimum + near:
            value = largest if largest >= channel.maximum - near else smallest
            findings.append(
                Finding(
                    Check.SATURATION,
                    (channel.name,),
                    f"{channel.name} is at the end of its range, {value:.4g} {channel.unit} of {channel.minimum:g} to "
                    f"{channel.maximum:g}: look at amplifier, span and preload.",
                )
            )
            continue
        # At rest a channel without noise has equal samples, too.
        swing = np.abs(record.moved[row]).max()
        for value in (largest, smallest):
            if (
                abs(value - rest[row]) > 0.2 * swing > SIGNIFICANT * record.floor[row]
                and _longest_run(values == value) >= shortest
            ):
                findings.append(
                    Finding(
                        Check.SATURATION,
                        (channel.name,),
                        f"{channel.name} stays at {value:.4g} {channel.unit} while it should move on: its amplifier or "
                        "converter is at its end.",
                    )
                )
    findings += [
        Finding(
            Check.SATURATION,
            (drive.name,),
            f"The actuator of {drive.name} is at its limit for {100 * drive.saturated_share:.0f} % of the time, at a "
            "pulse of a few per cent: look at valve, supply and preload.",
        )
        for drive in record.drives
        if drive.saturated_share > 0.0
    ]
    return findings


def _longest_run(flags: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _dead(record: _Record, expected: NDArray[np.float64] | None, known: Collection[str]) -> list[Finding]:
    """Find channels that follow no pulse; the noisy and saturated ones, `known`, cannot be judged."""
    significant = record.significant
    should = np.ones_like(significant)
    if expected is not None:
        should = np.abs(expected).max(axis=2) > 2.0 * SIGNIFICANT * record.floor[:, None]
    alone = np.array([drive.moves_alone for drive in record.drives])
    findings = []
    for row, channel in enumerate(record.responses):
        values = record.response[row]
        if significant[row].any() or channel.name in known or not should[row].any():
            continue
        what = "does not change at all" if (values == values[0]).all() else "follows no pulse beyond its noise"
        findings.append(
            Finding(
                Check.DEAD,
                (channel.name,),
                f"{channel.name} is dead: it {what}, its largest change is {record.peak[row].max():.3g} "
                f"{channel.unit}; look at sensor and cable.",
            )
        )
    # Without an expectation, a road's slope or speed may have no effect at rest.
    judged = alone if expected is None else np.any(should, axis=0)
    findings += [
        Finding(
            Check.DEAD,
            (drive.name,),
            f"{drive.name} is dead: no response follows its pulse; look at valve, supply and cable.",
        )
        for column, drive in enumerate(record.drives)
        if judged[column] and not significant[:, column].any()
    ]
    return findings


def _matched(record: _Record, match: Match) -> list[Finding]:
    """Return findings on channels that are inverted, swapped or unlike the expectation."""
    names = [channel.name for channel in record.responses]
    drives = [drive.name for drive in record.drives]
    findings = []
    for change in match.changes:
        swapped = change.alternatives[0].swaps
        described = [one.sentence(responses=names, drives=drives) for one in change.alternatives]
        channels = tuple(name for one in change.alternatives for name in one.names(responses=names, drives=drives))
        findings.append(
            Finding(
                Check.SWAPPED if swapped else Check.POLARITY,
                channels,
                f"{_capital(' or '.join(described))}; look at the cables, then at the sign in the controller.",
            )
        )
    for row, name in enumerate(names):
        if match.likeness[row] < _UNLIKE and record.significant[row].any():
            findings.append(
                Finding(
                    Check.CROSS_TALK,
                    (name,),
                    f"{name} answers the pulses otherwise than was expected: the correlation is "
                    f"{match.likeness[row]:.2f}; look for cross-talk, play and a changed specimen.",
                    failed=False,
                )
            )
    return findings


def _capital(sentence: str) -> str:
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _lag_and_gain(
    record: _Record, measured: NDArray[np.float64], expected: NDArray[np.float64], match: Match
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lag, gain = (np.full(len(measured), np.nan) for _ in range(2))
    for row, partner in enumerate(match.responses):
        # Only from pulses with an effect on the response: the rest is noise.
        moving = record.significant[row]
        if match.likeness[row] >= _CLEAR and moving.any() and not match.drives_changed:
            answer, wanted = measured[row, moving], match.sign[row] * expected[partner, moving]
            gain[row] = np.sum(answer * wanted) / np.sum(wanted**2)
            lag[row] = _best_lag(answer, wanted, round(_SEARCHED_LAG * record.sample_rate)) / record.sample_rate
    return lag, gain


def _best_lag(later: NDArray[np.float64], earlier: NDArray[np.float64], most: int) -> float:
    """Return the lag of records (parts, samples) behind others in samples, with fraction, at most `most` either way."""
    product = np.fft.irfft(np.fft.rfft(later) * np.conj(np.fft.rfft(earlier)), later.shape[-1]).sum(axis=0)
    shifts = np.arange(-most, most + 1)
    values = np.abs(product[shifts])
    best = int(np.clip(values.argmax(), 1, shifts.size - 2))
    before, at, after = values[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    return float(shifts[best] + (0.5 * (before - after) / bend if bend < 0.0 else 0.0))


def _lags(record: _Record, lag: NDArray[np.float64]) -> list[Finding]:
    largest = max(_LARGEST_LAG, _LAG_SAMPLES / record.sample_rate)
    return [
        Finding(
            Check.LAG,
            (channel.name,),
            f"{channel.name} is {1e3 * abs(value):.1f} ms {'behind' if value > 0.0 else 'ahead of'} what was expected; "
            f"{1e3 * largest:.1f} ms are allowed: look at filters and triggers.",
        )
        for channel, value in zip(record.responses, lag, strict=True)
        if abs(value) > largest
    ]


def _gains(record: _Record, gain: NDArray[np.float64]) -> list[Finding]:
    return [
        Finding(
            Check.GAIN,
            (channel.name,),
            f"{channel.name} is {value:.2g} times what was expected; look at sensitivity, range and unit.",
            failed=not 1.0 / _WRONG_GAIN <= value <= _WRONG_GAIN,
        )
        for channel, value in zip(record.responses, gain, strict=True)
        if np.isfinite(value) and not 1.0 / _LARGEST_GAIN <= value <= _LARGEST_GAIN
    ]


def _against_table(record: _Record, found: Sequence[Finding]) -> list[Finding]:
    """Compare sign and strongest drive of each response with the sensor table, if that states them."""
    known = {name for finding in found if finding.check in (Check.POLARITY, Check.SWAPPED) for name in finding.channels}
    names = [drive.name for drive in record.drives]
    findings = []
    for row, channel in enumerate(record.responses):
        if channel.name in known or not record.significant[row].any():
            continue
        strongest = int(record.peak[row].argmax())
        column = names.index(channel.drive) if channel.drive in names else strongest
        if record.peak[row, column] < _NAMED_SHARE * record.peak[row, strongest]:
            findings.append(
                Finding(
                    Check.SWAPPED,
                    (channel.name,),
                    f"{channel.name} is moved by {names[strongest]} and hardly by {channel.drive}, which the sensor "
                    "table names; look at the cables of both for a swap.",
                )
            )
        elif channel.polarity and (sign := _sign(record, row, column)) not in (0, channel.polarity):
            words = {1: "positive", -1: "negative"}
            findings.append(
                Finding(
                    Check.POLARITY,
                    (channel.name,),
                    f"{channel.name} is inverted: it is {words[sign]} while {names[column]} is positive, and the "
                    f"sensor table says {words[channel.polarity]}.",
                )
            )
    return findings


def _sign(record: _Record, row: int, column: int) -> int:
    """Return the sign of a response while a drive is positive; 0 if it does not follow the pulse clearly."""
    window = record.train.windows[column]
    answer, pulse = record.moved[row, window], record.train.drive[column, window]
    # An actuator follows with a lag of some samples.
    shifts = range(round(_SEARCHED_LAG * record.sample_rate) + 1)
    size = np.sqrt((answer @ answer) * (pulse @ pulse))
    related = max((float(answer[s:] @ pulse[: pulse.size - s]) / size for s in shifts), key=abs)
    return int(np.sign(related)) if abs(related) >= _CLEAR else 0
