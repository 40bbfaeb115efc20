"""Text of a new campaign file: a shipped campaign with another name, for another rig, or with a measured target."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from duralab.campaign.loading import ImportSettings, parse_campaign, shipped_campaigns
from duralab.campaign.rig_experiment import PulseLevels, in_one_line, plain, rig_comment, with_experiment
from duralab.campaign.target_edit import SourceChannel
from duralab.data import Rig, Signals
from duralab.errors import InputError
from duralab_settings import Section

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


def measured_target(
    signals: Signals, *, source: Path, folder: Path, rig: Rig, settings: ImportSettings | None = None
) -> tuple[str, list[str]]:
    """Return the section `target` for a measured file, and the responses without a channel of the same name in it.

    `signals`: Signals of the file. `source`: Path of the file. `folder`: Folder of the campaign file, the base of
    relative paths. `rig`: Rig with the responses. `settings`: Channels, calculated channels and steps of editing of the
    section.
    Returns: YAML text of the section, and the names of the responses for which neither a name nor `settings` says a
    channel.
    """
    settings = settings or ImportSettings()
    given = {channel.name: channel.unit for channel in signals.channels}
    named = {*given, *(channel.name for channel in settings.calculated)}
    missing = [one.name for one in rig.responses if one.name not in named and one.name not in settings.channels]
    lines = [
        "target:",
        f"  # {signals.duration:.6g} s at {signals.sample_rate:g} Hz; its channels, with the units that it names:",
        *_listed([f"{name} [{unit or 'no unit'}]" for name, unit in given.items()]),
        f"  file: {_quoted(os.path.relpath(source.resolve(), folder.resolve()))}",
        "  # For each response of the rig the file's channel: {from: NAME, unit: kN, scale: -1}, or its name alone.",
    ]
    if missing or settings.channels:
        # A channel is not guessed: a wrong one would be reproduced without a warning.
        channels: dict[str, Any] = {
            name: f"CHANNEL_FOR_{name.upper()}" if name in missing else name
            for name in (one.name for one in rig.responses)
        }
        channels |= {name: _short(channel) for name, channel in settings.channels.items()}
        lines += ["  channels:", *(f"    {in_one_line(name)}: {in_one_line(channels[name])}" for name in channels)]
    else:
        lines.append("  # All have the names that the rig's responses have, so that nothing needs to be said.")
    if settings.calculated:
        lines += ["  # Channels that are calculated from those of the file.", "  calculated:"]
        lines += [f"    - {in_one_line(_stated(one))}" for one in settings.calculated]
    steps = [f"{step.name}: {in_one_line(_stated(step.settings))}" for step in settings.edit]
    rates = [signals.sample_rate, *(step.resample.rate for step in settings.edit if step.resample is not None)]
    if rates[-1] != rig.sample_rate:
        steps.append(f"resample: {{rate: {rig.sample_rate:g}}}")
    if steps:
        lines += ["  # What is done with it, one step after the other.", "  edit:"]
        lines += [f"    - {step}" for step in steps]
    return "\n".join(lines) + "\n", missing


def _stated(section: Section) -> dict[str, Any]:
    """Return what a section states beyond its defaults."""
    return section.model_dump(mode="json", exclude_defaults=True)


def _short(channel: SourceChannel) -> str | dict[str, Any]:
    """Return a channel as in a campaign file: by its name alone, if nothing else is stated."""
    stated = _stated(channel)
    return channel.source if len(stated) == 1 else stated


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
