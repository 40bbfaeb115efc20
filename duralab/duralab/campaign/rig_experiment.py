"""Parts of a campaign file made from a rig's description: its channels, and an experiment within its limits."""

from __future__ import annotations

import math
import re
from typing import Final

import numpy as np

from duralab.data import Channel, Rig
from duralab.errors import InputError
from duralab_settings import dump_yaml

_RANGE_SHARE: Final = 0.01
"""RMS of a drive as a share of its limit: with peaks of about 4.5 times the RMS, a twentieth of the range is used."""
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
_AT_TARGET: Final = re.compile(r"(?m)^  # A second experiment.*\n  at_target:\n(?:    .*\n)+")
"""Second experiment, which needs as many responses as drives, and a model that is good at its level."""


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


def with_experiment(text: str, rig: Rig) -> str:
    """Return the text of a campaign file whose experiment fits a rig: its band, levels, length and blocks."""
    block = max(_SMALLEST_BLOCK, 2 ** math.ceil(math.log2(_BLOCK_SECONDS * rig.sample_rate)))
    seconds = block / rig.sample_rate
    highest = min(_HIGHEST, _USABLE_BAND * rig.sample_rate)
    corner = min(_CORNER, highest)
    realisations, duration = _length(rig, seconds)
    levels = [
        f"    {_key(channel.name)}: {level_of(channel, rig, highest=highest, corner=corner):g}\n"
        for channel in rig.drives
    ]
    count = len(rig.drives)
    changes = (
        ("highest_frequency: .*", f"highest_frequency: {highest:g}"),
        ("corner_frequency: .*", f"corner_frequency: {corner:g}"),
        ("decibels_per_octave: .*", f"decibels_per_octave: {_DECIBELS_PER_OCTAVE:g}"),
        (
            r"# RMS of each drive(?:.*\n)+?  rms:\n(?:    .*\n)+",
            f"# RMS of each drive in its unit: {100 * _RANGE_SHARE:.0f} % of its limit, less where its rate limit "
            "demands it.\n"
            "  # Take far less for a stiff drive: 0.1 mm of stroke may be a force of 500 N. The report states what\n"
            "  # the identification cost the specimen, and the factor for one pass of the target.\n"
            f"  rms:\n{''.join(levels)}",
        ),
        (
            r"# Length of the experiment.*\n  duration: .*",
            f"# Length of the experiment, in seconds: {realisations} x {count} experiments of {_BLOCKS_OF_EXPERIMENT} "
            f"blocks.\n  duration: {duration:g}",
        ),
    )
    text = _in_section(_AT_TARGET.sub("", text), "excitation", changes)
    blocks = (
        r"# Samples in a block.*\n  block_samples: .*",
        f"# Samples in a block: {block} at {rig.sample_rate:g} Hz are {seconds:.3g} s, "
        f"a line every {1 / seconds:.2g} Hz.\n"
        f"  block_samples: {block}",
    )
    text = _in_section(text, "estimator", (blocks,))
    control_highest = min(_CONTROL_HIGHEST, _CONTROL_HIGHEST / _HIGHEST * highest)
    return _in_section(text, "control_band", (("highest_frequency: .*", f"highest_frequency: {control_highest:.3g}"),))


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


def level_of(channel: Channel, rig: Rig, *, highest: float, corner: float) -> float:
    """Return an RMS of a drive well within its limits, in its unit."""
    allowed = []
    if _has_range(channel) and channel.minimum < 0.0 < channel.maximum:
        allowed.append(_RANGE_SHARE * min(-channel.minimum, channel.maximum))
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


def _key(name: str) -> str:
    """Return a channel's name as a key of YAML."""
    return dump_yaml(name, width=math.inf).splitlines()[0]


def plain(text: str) -> str:
    """Return a text of a rig for a comment: one line of printable characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
