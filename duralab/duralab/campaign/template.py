"""Text of a new campaign file: a shipped campaign with another name, for another rig, or with a measured target."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from duralab.campaign.loading import parse_campaign, shipped_campaigns
from duralab.campaign.rig_experiment import PulseLevels, plain, rig_comment, with_experiment
from duralab.data import Rig, Signals
from duralab.errors import InputError

DEFAULT_TEMPLATE: Final = "front_axle_demo"
AWAITED_TARGET: Final = "target.csv"
"""Target of a campaign for which no measured file was given."""

_NAME = re.compile(r"(?m)^name: .*$")
_RIG = re.compile(r"(?m)^rig: .*\n")
_HEADING = re.compile(r"\A(?:#.*\n)+")
_TARGET = re.compile(r"(?ms)^target:\n.*?(?=^# |\Z)")
"""Section from its key to the comment above the next key."""


def shipped_text(template: str) -> str:
    """Return the text of a shipped campaign.

    `template`: Name of the shipped campaign.
    Returns: YAML text with its comments.
    Raises `InputError`: There is no shipped campaign of this name.
    """
    if template not in (known := shipped_campaigns()):
        raise InputError(f"--from is {template!r}; shipped campaigns are {', '.join(known)}.", field="from")
    return (files("duralab.campaign") / "shipped" / f"{template}.yaml").read_text(encoding="utf-8")


def campaign_name(path: Path) -> str:
    """Return a campaign name made from a file's name, with the letters that a name may have.

    `path`: Path of the campaign file.
    Returns: Name of the campaign.
    """
    letters = re.sub(r"[^a-z0-9_-]+", "-", path.stem.lower()).strip("-_")
    return letters[:60] or "campaign"


def template_for(rig: str) -> str:
    """Return the shipped campaign for a rig, or the default one if there is none for it.

    `rig`: Name of the rig.
    Returns: Name of the shipped campaign.
    """
    fitting = [name for name in shipped_campaigns() if parse_campaign(shipped_text(name), name=name).rig == rig]
    return next((name for name in (DEFAULT_TEMPLATE, *fitting) if name in fitting), DEFAULT_TEMPLATE)


def campaign_text(
    template: str,
    *,
    path: Path,
    rig: Rig | None = None,
    target: str | None = None,
    levels: PulseLevels | None = None,
) -> str:
    """Return the text of a campaign file, checked.

    `template`: Shipped campaign to start from. `path`: Path of the file, which names the campaign. `rig`: Rig; the
    shipped campaign's if not given. For another rig, the experiment is made for its drives and its sample rate, and
    without `target` the file names a target file that the user must still add. `target`: Section `target`, from
    `measured_target`. `levels`: Levels of the experiment, for the rig that is given.
    Returns: YAML text that `parse_campaign` accepts, with its comments.
    Raises `InputError`: There is no such shipped campaign, or the rig does not describe the limits that an experiment
    needs.
    """
    text = shipped_text(template)
    heading = (
        f"# A campaign of your own, begun as the shipped {template}. Run it with `duralab run {path.name}`;\n"
        "# every key is checked before anything moves. docs/guides explain identification, iteration and targets.\n"
    )
    text = _HEADING.sub(lambda _: heading, text, count=1)
    text = _NAME.sub(f"name: {campaign_name(path)}", text, count=1)
    if rig is not None:
        other = rig.name != parse_campaign(text, name=str(path)).rig
        text = _RIG.sub(lambda _: f"{rig_comment(rig)}rig: {rig.name}\n", text, count=1)
        if other or levels is not None:
            # The levels are for its spectrum: others spend hundreds of passes of a target.
            text = with_experiment(text, rig, levels=levels)
            target = target or awaited_target(rig)
    if target is not None:
        text = _TARGET.sub(lambda _: target + "\n", text, count=1)
    parse_campaign(text, name=str(path))
    return text


def measured_target(signals: Signals, *, source: Path, folder: Path, rig: Rig) -> tuple[str, list[str]]:
    """Return the section `target` for a measured file, and the responses without a channel of the same name in it.

    `signals`: Signals of the file. `source`: Path of the file. `folder`: Folder of the campaign file, the base of
    relative paths. `rig`: Rig with the responses.
    Returns: YAML text of the section, and the names of those responses.
    """
    given = {channel.name: channel.unit for channel in signals.channels}
    missing = [channel.name for channel in rig.responses if channel.name not in given]
    lines = [
        "target:",
        f"  # {signals.duration:.6g} s at {signals.sample_rate:g} Hz; its channels, with the units that it names:",
        *_listed([f"{name} [{unit or 'no unit'}]" for name, unit in given.items()]),
        f"  file: {_quoted(os.path.relpath(source.resolve(), folder.resolve()))}",
        "  # For each response of the rig the file's channel: {from: NAME, unit: kN, scale: -1}, or its name alone.",
    ]
    mapping = [(channel.name, channel.name in given) for channel in rig.responses]
    if all(known for _, known in mapping):
        lines.append("  # All have the names that the rig's responses have, so that nothing needs to be said.")
    else:
        lines.append("  channels:")
        # The channel is not guessed: a wrong one would be reproduced without a warning.
        lines += [f"    {name}: {name if known else f'CHANNEL_FOR_{name.upper()}'}" for name, known in mapping]
    if signals.sample_rate != rig.sample_rate:
        lines += ["  # What is done with it, one step after the other.", "  edit:"]
        lines.append(f"    - resample: {{rate: {rig.sample_rate:g}}}")
    return "\n".join(lines) + "\n", missing


def awaited_target(rig: Rig) -> str:
    """Return the section `target` for a file that does not exist yet."""
    wanted = [f"{plain(channel.name)} [{plain(channel.unit)}]" for channel in rig.responses]
    return "\n".join(
        [
            "target:",
            f"  # The file to reproduce, relative to this one, with the responses at {rig.sample_rate:g} Hz:",
            *_listed(wanted),
            f"  # `duralab import MEASURED {AWAITED_TARGET} --rig {rig.name}` makes it of a measured file.",
            f"  file: {AWAITED_TARGET}",
            "",
        ]
    )


def _listed(names: Sequence[str], *, width: int = 116) -> list[str]:
    """Return names as lines of a comment."""
    lines, line = [], ""
    for name in names:
        if line and len(line) + len(name) + 2 > width - 4:
            lines.append(f"  # {line},")
            line = ""
        line = f"{line}, {name}" if line else name
    return [*lines, f"  # {line}"]


def _quoted(path: str) -> str:
    """Return a path, quoted for YAML if necessary."""
    return path if re.fullmatch(r"[A-Za-z0-9_./-]+", path) and path[0] != "-" else "'" + path.replace("'", "''") + "'"
