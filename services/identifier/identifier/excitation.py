"""The drives of an identification: independent Gaussian noise shaped to a PSD, at exact levels, inside the limits."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from duralab_proto.v1 import array_pb2
from identifier.rig_under_test import RigUnderTest
from identifier.settings import ExperimentSettings, SettingError, WhitePink
from spectra import line_frequencies, require_sample_rate


def pure_random(
    spectrum: WhitePink, *, rms: Sequence[float], samples: int, fade_samples: int, sample_rate: float, seed: int
) -> NDArray[np.float64]:
    """Gaussian noise shaped to a PSD, independent for every drive.

    Every line of the record gets a complex Gaussian amplitude, so nothing but the fades reaches beyond the band.

    Parameters
    ----------
    spectrum
        Shape of the PSD of every drive; the band must hold a line of the record.
    rms
        RMS of each drive between the fades, in its unit; met exactly.
    samples
        Length of the record, 2 or more.
    fade_samples
        Samples of the linear fade at either end, 0 up to less than half the record.
    sample_rate
        In hertz, greater than 0.
    seed
        Root of one independent stream per drive; a drive's stream does not depend on how many others there are.

    Returns
    -------
    numpy.ndarray
        Shape (drives, samples).

    Raises
    ------
    ValueError
        Where the record is shorter than its fades or than one period of the band.

    Notes
    -----
    Source: Bendat & Piersol, *Random Data*; the excitation "pure random" of Cornelis et al., ISMA 2014.
    """
    require_sample_rate(sample_rate)
    if fade_samples < 0 or samples < 2 or 2 * fade_samples >= samples:
        raise ValueError(
            f"Fades of {fade_samples} samples at both ends of {samples} leave nothing between; take shorter fades."
        )
    density = spectrum.density(line_frequencies(samples, sample_rate))
    if not density.any():
        raise ValueError(
            f"A record of {samples / sample_rate:g} s has no line from {spectrum.lowest_frequency:g} to "
            f"{spectrum.highest_frequency:g} Hz; take a longer one or a wider band."
        )
    streams = np.random.SeedSequence(seed).spawn(len(rms))
    drive = np.stack([_shaped_noise(np.random.default_rng(stream), np.sqrt(density), samples) for stream in streams])
    between = drive[:, fade_samples : samples - fade_samples]
    drive *= (np.asarray(rms) / np.sqrt(np.mean(between**2, axis=1)))[:, None]
    return drive * linear_fades(samples, fade_samples)


def linear_fades(samples: int, fade_samples: int) -> NDArray[np.float64]:
    """Weight that rises linearly from 0 at the start, is 1, and falls linearly to 0 at the end.

    Parameters
    ----------
    samples
        Length of the record.
    fade_samples
        Samples of each fade, 0 for none, at most half the record.

    Returns
    -------
    numpy.ndarray
        Shape (samples), 0 to 1.
    """
    weight = np.ones(samples)
    if fade_samples > 0:
        rise = np.arange(fade_samples) / fade_samples
        weight[:fade_samples] = rise
        weight[samples - fade_samples :] = rise[::-1]
    return weight


def check_levels(
    drive: NDArray[np.float64], *, channels: Sequence[array_pb2.Channel], rms: Sequence[float], sample_rate: float
) -> None:
    """Refuse a drive that would pass a limit of its channel, before it is played.

    Parameters
    ----------
    drive
        Shape (drives, samples), each row in its channel's unit.
    channels
        The drives in order, with minimum, maximum and, where one is stated, the slew limit.
    rms
        The RMS each was made with, in its unit.
    sample_rate
        In hertz.

    Raises
    ------
    SettingError
        Where drives pass their limits; names every such drive with its peak, the limit and the RMS that would fit.
    """
    offences = []
    for row, channel, level in zip(drive, channels, rms, strict=True):
        reaches = [
            (float(row.max()), channel.maximum, channel.unit),
            (float(row.min()), channel.minimum, channel.unit),
        ]
        if channel.slew_limit > 0.0 and row.size > 1:
            fastest = float(np.max(np.abs(np.diff(row)))) * sample_rate
            reaches.append((fastest, channel.slew_limit, f"{channel.unit}/s"))
        peak, limit, unit = max(reaches, key=lambda reach: _excess(reach[0], reach[1]))
        excess = _excess(peak, limit)
        if excess > 1.0:
            fitting = _round_down(level / excess)
            offences.append(
                f"{channel.name} would reach {peak:.4g} {unit} beyond its limit of {limit:g} {unit} "
                + (f"(an RMS of {fitting:g} {channel.unit} fits)" if fitting > 0.0 else "(no RMS fits)")
            )
    if offences:
        raise SettingError(f"The excitation is too large: {'; '.join(offences)}.", field="excitation.rms")


def make_drive(settings: ExperimentSettings, rig: RigUnderTest) -> NDArray[np.float64]:
    """Make the drive of an experiment and check it against the rig's limits.

    Parameters
    ----------
    settings
        Checked against the rig, see `check_against_rig`.
    rig
        What it is for.

    Returns
    -------
    numpy.ndarray
        Shape (drives, samples), each row in its channel's unit.

    Raises
    ------
    SettingError
        Where a drive would pass a limit.
    """
    drive = pure_random(
        settings.spectrum,
        rms=settings.rms,
        samples=settings.samples(rig.sample_rate),
        fade_samples=settings.fade_samples(rig.sample_rate),
        sample_rate=rig.sample_rate,
        seed=settings.seed,
    )
    check_levels(drive, channels=rig.drives, rms=settings.rms, sample_rate=rig.sample_rate)
    return drive


def _shaped_noise(generator: np.random.Generator, amplitude: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    lines = generator.standard_normal((2, amplitude.size))
    return np.asarray(fft.irfft(amplitude * (lines[0] + 1j * lines[1]), samples), dtype=np.float64)


def _excess(peak: float, limit: float) -> float:
    """Peak over limit in that direction; infinite where the limit leaves no room at all."""
    if peak == 0.0:
        return 0.0
    return peak / limit if peak * limit > 0.0 else np.inf if limit == 0.0 else 0.0


def _round_down(value: float) -> float:
    """Three significant digits, never more than the value."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return float(np.floor(value / unit) * unit)
