"""Position of a drive in the record of a controller, and check that the record belongs to the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from duralab_drive_files.errors import DriveFileError

LEAST_CORRELATION: Final = 0.99
"""Least correlation of a recorded command with its drive, over the whole of it."""

LARGEST_GAIN_ERROR: Final = 0.02
LARGEST_OFFSET: Final = 0.02
"""Largest offset of a recorded command, as a share of the drive's limit."""

LARGEST_DRIFT: Final = 0.05
"""Largest change of the lag from the first to the last sample, in samples."""

_LEAST_MOVING: Final = 1e-4
"""RMS over the limit from which a drive counts as moving: three steps of a 16-bit file."""

_NOISE: Final = 1e-3
"""RMS over the limit by which a recorded command may always differ."""

_FOLLOWS: Final = 0.9
"""Correlation at a whole lag above which a command follows a drive: up to half a sample and a drift are found later."""

_PIECES: Final = 20
_HALF_LENGTH: Final = 64
_KAISER_BETA: Final = 12.3
_ITERATIONS: Final = 8


@dataclass(frozen=True)
class Alignment:
    """Position of a drive in a record.

    Parameters
    ----------
    lag : float
        Samples by which the record's first sample precedes that of the drive; not a whole number.
    drift : float
        Change of the lag from the first to the last sample, in samples.
    gain, offset : tuple of float
        Gain and offset of each recorded command: it is `gain` times its drive plus `offset`, in the drive's unit. 1 and
        0 if the drive does not move, or no command was recorded.
    correlation : tuple of float
        Correlation of each recorded command with its drive; 1 if the drive does not move.
    """

    lag: float
    drift: float
    gain: tuple[float, ...]
    offset: tuple[float, ...]
    correlation: tuple[float, ...]


def shifted(samples: np.ndarray, lag: float, length: int) -> np.ndarray:
    """Return part of a record, from a time between its samples.

    Parameters
    ----------
    samples : ndarray, shape (channels, samples)
        Record without content above 0.87 of half its sample rate.
    lag : float
        Start of the result, in samples.
    length : int
        Number of samples of the result; it begins and ends within the record, or less than a sample beyond.

    Returns
    -------
    ndarray, shape (channels, length)
        Shifted record, exact to 1e-6 except for 64 samples at the ends of the record, beyond which it is extended by
        odd reflection.
    """
    whole = int(np.floor(lag))
    fraction = lag - whole
    if fraction == 0.0 and 0 <= whole <= samples.shape[1] - length:
        return samples[:, whole : whole + length].copy()
    before, after = _HALF_LENGTH, _HALF_LENGTH + 1
    first, last = whole - before, whole + length + after
    margins = (max(-first, 0), max(last - samples.shape[1], 0))
    part = samples[:, max(first, 0) : last]
    part = np.pad(part, ((0, 0), margins), mode="reflect", reflect_type="odd")
    place = np.arange(-before, after + 1) - fraction
    window = np.i0(_KAISER_BETA * np.sqrt(np.maximum(1.0 - (place / after) ** 2, 0.0))) / np.i0(_KAISER_BETA)
    kernel = np.sinc(place) * window
    kernel /= kernel.sum()
    return np.stack([np.convolve(row, kernel[::-1], mode="valid")[:length] for row in part])


def align(
    recorded: np.ndarray, drive: np.ndarray, *, limits: Sequence[float], names: Sequence[str], rate: float
) -> Alignment:
    """Find a drive in recorded commands, and refuse a record of another drive.

    Parameters
    ----------
    recorded, drive : ndarray, shape (drives, samples)
        Signals at one sample rate, each row in its drive's unit; the record is the longer one.
    limits : sequence of float
        Largest magnitude of each drive.
    names : sequence of str
        Names of the drives.
    rate : float
        Sample rate in Hz.

    Returns
    -------
    Alignment
        Alignment with one lag for all drives.

    Raises
    ------
    DriveFileError
        If the record does not follow the drive, ends before it or begins after it, or its clock drifts; one sentence.
    """
    moving = np.std(drive, axis=1) > _LEAST_MOVING * np.asarray(limits)
    if not moving.any():
        raise DriveFileError("no drive moves, so the response cannot be aligned with it; play a larger drive.")
    whole = _whole_lag(recorded[moving], drive[moving])
    _require_correlated(recorded, drive, whole, moving, names)
    _require_covered(recorded.shape[1], drive.shape[1], whole, rate)
    lag, drift, uncertainty = _refined(recorded[moving], drive[moving], float(whole))
    _require_covered(recorded.shape[1], drive.shape[1], lag, rate, slack=1.0)
    found = _compared(shifted(recorded, lag, drive.shape[1]), drive, moving)
    _judge(found, recorded, drive, whole, moving=moving, limits=np.asarray(limits), names=names)
    if abs(drift) > LARGEST_DRIFT + 6.0 * uncertainty:
        raise DriveFileError(_drift_sentence(drift, drive.shape[1]))
    return Alignment(lag, drift, *(tuple(map(float, row)) for row in (found.gain, found.offset, found.correlation)))


def _require_covered(recorded: int, drive: int, lag: float, rate: float, *, slack: float = 0.0) -> None:
    if lag < -slack:
        raise DriveFileError(
            f"it begins {-lag / rate:.3f} s after the drive does; start the acquisition before the drive."
        )
    if (missing := lag + drive - recorded) > slack:
        raise DriveFileError(
            f"it ends {missing / rate:.3f} s before the drive does; record all of the drive, and save the last frame."
        )


def _whole_lag(recorded: np.ndarray, drive: np.ndarray) -> int:
    """Return the lag of the largest cross-correlation, summed over the channels."""
    size = recorded.shape[1] + drive.shape[1]
    total = np.zeros(_fast_size(size))
    for one, other in zip(recorded, drive, strict=True):
        total += _cross_correlation(one, other, len(total))
    lag = int(np.argmax(total))
    return lag if lag < recorded.shape[1] else lag - len(total)


def _fast_size(size: int) -> int:
    return 1 << (size - 1).bit_length()


def _cross_correlation(recorded: np.ndarray, drive: np.ndarray, size: int) -> np.ndarray:
    """Return the correlation at each lag, over the RMS values of both; negative lags at the end."""
    one, other = recorded - recorded.mean(), drive - drive.mean()
    scale = np.sqrt(np.sum(one**2) * np.sum(other**2)) or 1.0
    return np.fft.irfft(np.fft.rfft(one, size) * np.conj(np.fft.rfft(other, size)), size) / scale


def _overlap(recorded: np.ndarray, drive: np.ndarray, lag: int) -> tuple[np.ndarray, np.ndarray]:
    begin = max(-lag, 0)
    end = max(min(drive.shape[-1], recorded.shape[-1] - lag), begin)
    return recorded[..., begin + lag : end + lag], drive[..., begin:end]


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    if one.size < 2:
        return 0.0
    one, other = one - one.mean(), other - other.mean()
    scale = float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    return float(np.sum(one * other)) / scale if scale > 0.0 else 0.0


def _require_correlated(
    recorded: np.ndarray, drive: np.ndarray, lag: int, moving: np.ndarray, names: Sequence[str]
) -> None:
    """Refuse a record that does not follow the drive at a whole lag, with the reason if it can be detected."""
    rows: list[int] = np.flatnonzero(moving).tolist()
    bad = [names[row] for row in rows if not _correlation(*_overlap(recorded[row], drive[row], lag)) > _FOLLOWS]
    if not bad:
        return
    pairs = _best_pairs(recorded[moving], drive[moving])
    if pairs is None:
        drift = _large_drift(recorded[moving], drive[moving], lag)
        raise DriveFileError(
            drift
            or "its recorded commands do not follow this drive; it is the record of another run or was broken off, "
            "give that of this run."
        )
    found = []
    for row, (other, sign) in zip(rows, pairs, strict=True):
        name, follows = names[row], names[rows[other]]
        if follows != name:
            found.append(f"the command of {name} follows {follows}")
        elif sign < 0:
            found.append(f"the command of {name} is inverted")
    if not found:
        found = [f"the command of {', '.join(bad)} does not follow its drive"]
    raise DriveFileError(f"{', '.join(found)}; correct the channels and signs of the map or of the controller.")


def _best_pairs(recorded: np.ndarray, drive: np.ndarray) -> list[tuple[int, int]] | None:
    """Return the drive that each recorded command follows at one lag, and its sign; None if one follows none."""
    size = _fast_size(recorded.shape[1] + drive.shape[1])
    total = np.zeros(size)
    for one in recorded:
        best = np.zeros(size)
        for other in drive:
            np.maximum(best, np.abs(_cross_correlation(one, other, size)), out=best)
        total += best
    lag = int(np.argmax(total))
    lag = lag if lag < recorded.shape[1] else lag - size
    pairs = []
    for one in recorded:
        each = [_correlation(*_overlap(one, other, lag)) for other in drive]
        best = max(range(len(each)), key=lambda index: abs(each[index]))
        if abs(each[best]) < _FOLLOWS:
            return None
        pairs.append((best, int(np.sign(each[best]))))
    return pairs


def _large_drift(recorded: np.ndarray, drive: np.ndarray, lag: int) -> str:
    """Return as text that the ends of a drive have different lags around a known one, or an empty string."""
    samples = drive.shape[1]
    part, reach = samples // 5, max(samples // 1000, 3)
    lags = []
    for begin in (0, samples - part):
        piece = drive[:, begin : begin + part]
        near = range(lag + begin - reach, lag + begin + reach + 1)
        each = [
            min(_correlation(*_overlap(one, other, at)) for one, other in zip(recorded, piece, strict=True))
            for at in near
        ]
        if max(each) < _FOLLOWS:
            return ""
        lags.append(near[int(np.argmax(each))] - begin)
    return _drift_sentence(lags[1] - lags[0], samples) if lags[0] != lags[1] else ""


def _drift_sentence(drift: float, samples: int) -> str:
    return (
        f"the lag changes by {drift:.3g} samples from the first to the last sample ({1e6 * drift / samples:.0f} ppm of "
        f"the clock), and {LARGEST_DRIFT:g} are allowed; let one clock drive output and acquisition."
    )


def _refined(recorded: np.ndarray, drive: np.ndarray, lag: float) -> tuple[float, float, float]:
    """Return lag, drift and its standard deviation, by Gauss-Newton iterations from a whole lag.

    A late record is `drive + rest · drive'`, and one whose clock drifts has a rest that grows along the drive.
    """
    room = recorded.shape[1] - drive.shape[1]
    samples = drive.shape[1]
    # The reflected extension at the ends of the record is no measurement.
    edge = min(_HALF_LENGTH, samples // 8)
    inner = slice(edge, samples - edge)
    wide = np.pad(drive, ((0, 0), (2, 2)), mode="edge")
    # Central differences of fourth order.
    slope = ((8.0 * (wide[:, 3:-1] - wide[:, 1:-3]) - (wide[:, 4:] - wide[:, :-4])) / 12.0)[:, inner]
    along = (np.arange(samples)[inner] - 0.5 * (samples - 1)) / samples
    weight = 1.0 / np.var(drive, axis=1)
    drift = uncertainty = 0.0
    for _ in range(_ITERATIONS):
        asked = min(max(lag, -0.999), room + 0.999)
        found = shifted(recorded, asked, samples)[:, inner]
        normal, right, squares = np.zeros((2, 2)), np.zeros(2), 0.0
        for row, (one, other) in enumerate(zip(found, drive[:, inner], strict=True)):
            free = _without(other, np.stack([one, slope[row], along * slope[row]]))
            gain = float(np.dot(one - one.mean(), other - other.mean()) / np.sum((other - other.mean()) ** 2))
            columns = gain * free[1:]
            normal += weight[row] * columns @ columns.T
            right += weight[row] * columns @ free[0]
            squares += weight[row] * float(free[0] @ free[0])
        step = np.linalg.solve(normal, right)
        left = max(squares - float(step @ right), 0.0) / max(found.size - 4.0, 1.0)
        drift, uncertainty = -float(step[1]), float(np.sqrt(left * np.linalg.inv(normal)[1, 1]))
        lag = asked - float(step[0])
        if abs(step[0]) < 1e-7:
            break
    return lag, drift, uncertainty


def _without(column: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return rows less the part that a constant and a column explain."""
    centred = column - column.mean()
    rows = rows - rows.mean(axis=1, keepdims=True)
    return rows - np.outer(rows @ centred / np.sum(centred**2), centred)


@dataclass(frozen=True)
class _Comparison:
    gain: np.ndarray
    offset: np.ndarray
    correlation: np.ndarray
    #: Largest RMS of the residual in a piece, in the drive's unit.
    left: np.ndarray
    #: Standard deviation of the gain.
    uncertainty: np.ndarray


def _compared(found: np.ndarray, drive: np.ndarray, moving: np.ndarray) -> _Comparison:
    gain, correlation = np.ones(len(drive)), np.ones(len(drive))
    uncertainty = np.zeros(len(drive))
    offset = (found - drive).mean(axis=1)
    for row in np.flatnonzero(moving):
        centred = drive[row] - drive[row].mean()
        energy = float(np.sum(centred**2))
        gain[row] = float(np.dot(found[row], centred)) / energy
        offset[row] = found[row].mean() - gain[row] * drive[row].mean()
        correlation[row] = _correlation(found[row], drive[row])
        uncertainty[row] = np.sqrt(np.mean((found[row] - gain[row] * drive[row] - offset[row]) ** 2) / energy)
    left = found - gain[:, None] * drive - offset[:, None]
    size = max(drive.shape[1] // _PIECES, 1)
    pieces = left[:, : size * (drive.shape[1] // size)].reshape(len(drive), -1, size)
    return _Comparison(gain, offset, correlation, np.sqrt(np.mean(pieces**2, axis=2)).max(axis=1), uncertainty)


def _judge(
    found: _Comparison,
    recorded: np.ndarray,
    drive: np.ndarray,
    lag: int,
    *,
    moving: np.ndarray,
    limits: np.ndarray,
    names: Sequence[str],
) -> None:
    """Refuse recorded commands that differ from the drive in size or at any time; names every bad one."""
    share = np.sqrt(1.0 - LEAST_CORRELATION**2)
    bad = []
    for row, name in enumerate(names):
        allowed = max(share * float(np.std(drive[row])), _NOISE * limits[row])
        gain = found.gain[row]
        if abs(found.offset[row]) > LARGEST_OFFSET * limits[row]:
            bad.append(
                f"the command of {name} is off by {100 * found.offset[row] / limits[row]:.1f} % of its limit, and "
                f"{100 * LARGEST_OFFSET:.0f} % are allowed"
            )
        if found.left[row] > allowed and not moving[row]:
            bad.append(f"the command of {name} moves, and its drive does not")
        elif found.left[row] > allowed:
            if drift := _large_drift(recorded[moving], drive[moving], lag):
                raise DriveFileError(drift)
            bad.append(
                f"the command of {name} does not follow its drive all along (correlation {found.correlation[row]:.4f}):"
                " the run was broken off, or it is that of another drive"
            )
        elif abs(gain - 1.0) > LARGEST_GAIN_ERROR + 4.0 * found.uncertainty[row]:
            bad.append(f"the command of {name} has {100 * gain:.1f} % of the drive's size; set the span to 100 %")
    if bad:
        raise DriveFileError(f"{'; '.join(bad)}. See to the controller and give the record of a new playback.")
