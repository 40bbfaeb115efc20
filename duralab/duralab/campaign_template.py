"""The text of a new campaign file: a shipped one under another name, perhaps with a measured target."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from duralab.campaign_loading import parse_campaign, shipped_campaigns
from duralab.errors import InputError
from duralab.rig import Rig
from duralab.signals import Signals

_NAME = re.compile(r"(?m)^name: .*$")
_HEADING = re.compile(r"\A(?:#.*\n)+")
_TARGET = re.compile(r"(?ms)^target:\n.*?(?=^# |\Z)")
"""From the key to the comment above the next one."""


def shipped_text(template: str) -> str:
    """Return the text of a shipped campaign.

    Raises
    ------
    InputError
        There is none of this name.
    """
    if template not in (known := shipped_campaigns()):
        raise InputError(f"--from is {template!r}; shipped campaigns are {', '.join(known)}.", field="from")
    return (files("duralab") / "campaigns" / f"{template}.yaml").read_text(encoding="utf-8")


def campaign_name(path: Path) -> str:
    """Return the name of a campaign in this file: the file's, in the letters that a name may have."""
    letters = re.sub(r"[^a-z0-9_-]+", "-", path.stem.lower()).strip("-_")
    return letters[:60] or "campaign"


def campaign_text(template: str, *, path: Path, target: str | None = None) -> str:
    """Return the text of a campaign file, checked.

    Parameters
    ----------
    template : str
        The shipped campaign to begin with.
    path : Path
        Of the file, which names the campaign.
    target : str, optional
        Section `target`, from `measured_target`.

    Raises
    ------
    InputError
        There is no such shipped campaign.
    """
    text = shipped_text(template)
    heading = (
        f"# A campaign of your own, begun as the shipped {template}. Run it with `duralab run {path.name}`;\n"
        "# every key is checked before anything moves. docs/guides explain identification, iteration and targets.\n"
    )
    text = _HEADING.sub(lambda _: heading, text, count=1)
    text = _NAME.sub(f"name: {campaign_name(path)}", text, count=1)
    if target is not None:
        text = _TARGET.sub(lambda _: target + "\n", text, count=1)
    parse_campaign(text, name=str(path))
    return text


def measured_target(signals: Signals, *, source: Path, folder: Path, rig: Rig) -> tuple[str, list[str]]:
    """Return the section `target` for a measured file, and the responses that have no channel of their name in it.

    Parameters
    ----------
    signals : Signals
        What the file holds.
    source : Path
        The file.
    folder : Path
        Of the campaign file, where relative paths start.
    rig : Rig
        Whose responses are wanted.
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
        # Which channel is meant is not guessed: a wrong one would be reproduced without a word.
        lines += [f"    {name}: {name if known else f'CHANNEL_FOR_{name.upper()}'}" for name, known in mapping]
    if signals.sample_rate != rig.sample_rate:
        lines += ["  # What is done with it, one step after the other.", "  edit:"]
        lines.append(f"    - resample: {{rate: {rig.sample_rate:g}}}")
    return "\n".join(lines) + "\n", missing


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
    """Return a path as YAML takes it."""
    return path if re.fullmatch(r"[A-Za-z0-9_./-]+", path) and path[0] != "-" else "'" + path.replace("'", "''") + "'"
