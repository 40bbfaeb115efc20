"""Parts of a campaign file made from a rig's description: its channels, and an experiment within its limits."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from duralab.data import Channel, PreTest, Rig, Signals
from duralab.errors import InputError
from duralab_settings import dump_yaml
from duralab_spectra import band_mask, dynamic_part

_RANGE_SHARE: Final = 0.01
"""RMS of a drive as a share of its limit: with peaks of about 4.5 times the RMS, a twentieth of the range is used."""
_LARGEST_SHARE: Final = 0.1
"""The same where pulses of a pre-test determine the level: peaks use about half of the range."""
_TARGET_SHARE: Final = 0.5
"""RMS, over the target's, of the response that a drive moves most by its level."""
_SLEW_SHARE: Final = 0.1
"""RMS of a drive's rate as a share of its slew limit: peaks use about half of it."""
_BLOCK_SECONDS: Final = 2.0
_SMALLEST_BLOCK: Final = 256
_LOWEST, _CORNER, _HIGHEST, _CONTROL_LOWEST, _CONTROL_HIGHEST = 0.4, 1.0, 45.0, 0.7, 35.0
"""Frequencies in Hz of the shipped campaigns, which a rig with a low sample rate does not reach."""
_USABLE_BAND: Final = 0.4
"""Largest frequency of the experiment as a share of the sample rate."""
_DECIBELS_PER_OCTAVE: Final = 6.0
_BLOCKS_OF_EXPERIMENT: Final = 3
"""Number of blocks: one in which the transient decays, and two that are captured."""
_FADE_SECONDS: Final = 1.0
_ROUNDING: Final = 1e-9
"""RMS of a target that does not move, over its largest value: rounding leaves less."""
_AT_TARGET: Final = re.compile(r"(?m)^  # A second experiment.*\n  at_target:\n(?:    .*\n)+")
"""Second experiment, which needs as many responses as drives, and a model that is good at its level."""


@dataclass(frozen=True)
class PulseLevels:
    """Levels of an experiment that follow from the pulses of a pre-test.

    Parameters
    ----------
    pre_test : str
        Id of its recording.
    rms : mapping of str to float
        RMS of each drive in its unit.
    """

    pre_test: str
    rms: Mapping[str, float]


def rig_comment(rig: Rig) -> str:
    """Return a rig's channels, units, sample rate and limits as lines of a comment."""
    lines = [
        f"# {plain(rig.specimen) or 'No specimen is described'}; {rig.sample_rate:g} Hz, drives up to "
        f"{rig.longest_drive_seconds:g} s."
    ]
    for kind, channels in (("Drives", rig.drives), ("Responses", rig.responses)):
        lines.append(f"# {kind}:")
        lines += [f"#   {plain(channel.name)} [{plain(channel.unit)}]{_limits(channel)}" for channel in channels]
    return "".join(f"{line}\n" for line in lines)


def _limits(channel: Channel) -> str:
    words = [f"{channel.minimum:g} to {channel.maximum:g}"] if _has_range(channel) else []
    words += [f"at most {channel.slew_limit:g} per second"] if channel.slew_limit > 0.0 else []
    return f" {', '.join(words)}" if words else ""


def _has_range(channel: Channel) -> bool:
    return math.isfinite(channel.minimum) and math.isfinite(channel.maximum)


def with_experiment(text: str, rig: Rig, *, levels: PulseLevels | None) -> str:
    """Return the text of a campaign file whose experiment fits a rig: its band, levels, length and blocks.

    Without `levels` they are shares of the limits.
    """
    block = max(_SMALLEST_BLOCK, 2 ** math.ceil(math.log2(_BLOCK_SECONDS * rig.sample_rate)))
    seconds = block / rig.sample_rate
    highest, corner = _band(rig)
    realisations, duration = _length(rig, seconds)
    if levels is None or realisations == 1 or len(rig.drives) != len(rig.responses):
        text = _AT_TARGET.sub("", text)
    else:
        text = _in_section(text, "excitation", (("  duration: .*", f"  duration: {duration:g}"),))
    count = len(rig.drives)
    changes = (
        ("highest_frequency: .*", f"highest_frequency: {highest:g}"),
        ("corner_frequency: .*", f"corner_frequency: {corner:g}"),
        ("decibels_per_octave: .*", f"decibels_per_octave: {_DECIBELS_PER_OCTAVE:g}"),
        (
            r"# Length of the experiment.*\n  duration: .*",
            f"# Length of the experiment, in seconds: {realisations} x {count} experiments of {_BLOCKS_OF_EXPERIMENT} "
            f"blocks.\n  duration: {duration:g}",
        ),
    )
    text = _in_section(text, "excitation", changes)
    text = _with_shares(text, rig) if levels is None else _with_pulse_levels(text, levels)
    blocks = (
        r"# Samples in a block.*\n  block_samples: .*",
        f"# Samples in a block: {block} at {rig.sample_rate:g} Hz are {seconds:.3g} s, "
        f"a line every {1 / seconds:.2g} Hz.\n"
        f"  block_samples: {block}",
    )
    text = _in_section(text, "estimator", (blocks,))
    control_highest = min(_CONTROL_HIGHEST, _CONTROL_HIGHEST / _HIGHEST * highest)
    return _in_section(text, "control_band", (("highest_frequency: .*", f"highest_frequency: {control_highest:.3g}"),))


def _with_shares(text: str, rig: Rig) -> str:
    comment = (
        f"RMS of each drive in its unit: {100 * _RANGE_SHARE:.0f} % of its limit, less where its rate limit demands "
        "it.\n"
        "  # Take far less for a stiff drive: 0.1 mm of stroke may be a force of 500 N. `duralab init --pre-test`\n"
        "  # takes levels from the pulses of a pre-test and the target. The report states what they cost."
    )
    levels = {channel.name: level_of(channel, rig, largest_share=_RANGE_SHARE) for channel in rig.drives}
    return _with_levels(text, levels, comment=comment)


def _with_pulse_levels(text: str, levels: PulseLevels) -> str:
    comment = (
        f"RMS of each drive in its unit, by the pulses of pre-test {plain(levels.pre_test)}:\n"
        f"  # the response that a drive moves most gets {_TARGET_SHARE:g} times the RMS of its target."
    )
    return _with_levels(text, levels.rms, comment=comment)


def _with_levels(text: str, levels: Mapping[str, float], *, comment: str) -> str:
    lines = [f"    {in_one_line(name)}: {level:g}\n" for name, level in levels.items()]
    pattern = r"# RMS of each drive(?:.*\n)+?  rms:\n(?:    .*\n)+"
    return _in_section(text, "excitation", ((pattern, f"# {comment}\n  rms:\n{''.join(lines)}"),))


def levels_by_pulses(pre_test: PreTest, *, rig: Rig, target: Signals, band: tuple[float, float]) -> PulseLevels:
    """Return levels at which the responses of an experiment stay below a target.

    A pulse shows how far a response moves for one unit of a drive. So a stiff drive, of which a hundredth of a
    millimetre is enough, gets a small level, however long its stroke is.

    `pre_test`: Pre-test of the rig. `rig`: Rig. `target`: All responses of the rig, in its order and units. `band`:
    Band of the target in Hz, above 0.
    Returns: RMS of each drive; a tenth of its limit, or less where its rate limit demands it, is never exceeded.
    Raises `InputError`: The pre-test is of other channels, or the target of a response does not move in the band.
    """
    for here, there in ((rig.drives, pre_test.drives), (rig.responses, pre_test.responses)):
        ours, theirs = (", ".join(f"{one.name} [{one.unit}]" for one in channels) for channels in (here, there))
        if ours != theirs:
            raise InputError(
                f"The pre-test {pre_test.id!r} has {theirs}, and rig {rig.name!r} has {ours}; make one of this rig "
                f"with `duralab pre-test {rig.name}`.",
                field="pre_test",
            )
    dynamic = dynamic_part(target.samples, lowest=band[0], sample_rate=target.sample_rate)
    frequency = np.fft.rfftfreq(dynamic.shape[1], 1.0 / target.sample_rate)
    lines = np.fft.rfft(dynamic, axis=1) * band_mask(frequency, *band, edge=0.0)
    wanted = np.sqrt(2.0 * np.sum(np.abs(lines) ** 2, axis=1)) / dynamic.shape[1]
    moves = wanted > _ROUNDING * np.abs(target.samples).max(axis=1)
    if still := [channel.name for channel, moving in zip(rig.responses, moves, strict=True) if not moving]:
        raise InputError(
            f"The target of {', '.join(still)} does not move from {band[0]:g} to {band[1]:g} Hz, so no level follows "
            "from it; leave --pre-test out, and choose the levels by the file's comments.",
            field="target",
        )
    # A response that a drive does not move shows its noise, and allows far more than others do.
    allowed = wanted[:, None] * np.abs(pre_test.amplitude) / np.maximum(pre_test.peak, np.finfo(float).tiny)
    levels = _TARGET_SHARE * allowed.min(axis=0)
    return PulseLevels(
        pre_test.id,
        {
            channel.name: min(_rounded_down(float(level)), level_of(channel, rig, largest_share=_LARGEST_SHARE))
            for channel, level in zip(rig.drives, levels, strict=True)
        },
    )


def _band(rig: Rig) -> tuple[float, float]:
    """Return the largest frequency of the experiment and the end of its flat part, in Hz."""
    highest = min(_HIGHEST, _USABLE_BAND * rig.sample_rate)
    return highest, min(_CORNER, highest)


def _length(rig: Rig, block_seconds: float) -> tuple[int, float]:
    """Return the number of realisations (two, or one on a rig with short drives) and their length in s."""
    each = len(rig.drives) * _BLOCKS_OF_EXPERIMENT * block_seconds
    for realisations in (2, 1):
        duration = float(math.ceil(realisations * each + _FADE_SECONDS))
        if duration <= rig.longest_drive_seconds:
            return realisations, duration
    raise InputError(
        f"Rig {rig.name!r} plays {rig.longest_drive_seconds:g} s at most; an experiment of its {len(rig.drives)} "
        f"drives takes {each + _FADE_SECONDS:g} s, so copy a shipped campaign and choose a shorter one.",
        field="rig",
    )


def level_of(channel: Channel, rig: Rig, *, largest_share: float) -> float:
    """Return an RMS of a drive well within its limits, in its unit; `largest_share`: RMS over the smaller limit."""
    highest, corner = _band(rig)
    allowed = []
    if _has_range(channel) and channel.minimum < 0.0 < channel.maximum:
        allowed.append(largest_share * min(-channel.minimum, channel.maximum))
    if allowed and channel.slew_limit > 0.0:
        allowed.append(_SLEW_SHARE * channel.slew_limit / _rate_of_unit_rms(highest=highest, corner=corner))
    if not allowed:
        raise InputError(
            f"Rig {rig.name!r} allows its drive {channel.name!r} {channel.minimum:g} to {channel.maximum:g} "
            f"{channel.unit}; an experiment around 0 needs finite limits on both sides of it, so correct the rig's "
            "description, or copy a shipped campaign and choose its excitation.",
            field="rig",
        )
    return _rounded_down(min(allowed))


def _rate_of_unit_rms(*, highest: float, corner: float) -> float:
    """Return the RMS rate in 1/s of a drive of RMS 1 whose spectral density is flat to the corner and falls above."""
    frequency = np.geomspace(_LOWEST, highest, 4096)
    density = np.minimum(1.0, (frequency / corner) ** (-_DECIBELS_PER_OCTAVE / (10.0 * math.log10(2.0))))
    power = np.trapezoid(density, frequency)
    return float(2.0 * np.pi * np.sqrt(np.trapezoid(density * frequency**2, frequency) / power))


def _rounded_down(value: float) -> float:
    """Return a value rounded down to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit) * unit:.2g}")


def _in_section(text: str, section: str, changes: tuple[tuple[str, str], ...]) -> str:
    """Replace each pattern once in a section of a text; return the text."""
    found = re.search(rf"(?ms)^{section}:\n.*?(?=^# |\Z)", text)
    if found is None:
        raise ValueError(f"The shipped campaign has no section {section}.")
    content = found[0]
    for pattern, replacement in changes:
        content, count = re.subn(rf"(?m)^  {pattern}", lambda _, new=replacement: f"  {new}", content, count=1)
        if count != 1:
            raise ValueError(f"Section {section} of the shipped campaign has no {pattern!r}.")
    return text[: found.start()] + content + text[found.end() :]


def in_one_line(content: object) -> str:
    """Return a name or a mapping as YAML in one line."""
    return dump_yaml(content, flow=True, width=math.inf).splitlines()[0]


def plain(text: str) -> str:
    """Return a text of a rig for a comment: one line of printable characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
