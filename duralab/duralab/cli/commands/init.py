"""`duralab init`: a campaign file to begin with."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.options import (
    Connect,
    Json,
    Replace,
    TargetSettings,
    complete_campaign,
    complete_rig,
    endpoint_if_any,
    open_lab,
)
from duralab.cli.output import Output, own_command
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.campaign import PulseLevels
    from duralab.data import Rig


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The campaign file to write.")] = Path("campaign.yaml"),
    *,
    template: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="CAMPAIGN",
            help="The shipped campaign to begin with; the one for the rig, else front_axle_demo, if left out.",
            autocompletion=complete_campaign,
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig",
            metavar="RIG",
            help="The rig that reproduces the target; also one of the lab or gateway at --connect.",
            autocompletion=complete_rig,
        ),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            "--target", metavar="SIGNALS", help="A measured file to reproduce instead of the target of CAMPAIGN."
        ),
    ] = None,
    settings: TargetSettings = None,
    pre_test: Annotated[
        Path | None,
        typer.Option(
            "--pre-test",
            metavar="RECORDING",
            help="A passed pre-test of the rig: levels of the identification from its pulses and --target.",
        ),
    ] = None,
    endpoint: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write a campaign file with a comment above every key, for a shipped rig or one of a running lab."""
    from duralab.campaign import (
        AWAITED_TARGET,
        DEFAULT_TEMPLATE,
        campaign_name,
        campaign_text,
        load_campaign,
        load_import_settings,
        measured_target,
        missing_target,
        parse_campaign,
        shipped_text,
        template_for,
    )
    from duralab.formats import read_signals
    from duralab.output_files import replace_when_complete, require_outputs
    from duralab.recording import open_recording

    output = Output(as_json)
    for option, value in (("pre-test", pre_test), ("settings", settings)):
        if value is not None and target is None:
            raise InputError(f"--{option} is given without --target; give the measured file too.", field=option)
    require_outputs([file], read=[path for path in (target, settings, pre_test) if path is not None], replace=replace)
    asked = load_import_settings(settings) if settings is not None else None
    if pre_test is not None:
        rig = rig or open_recording(pre_test).rig.rig
    template = template or (template_for(rig) if rig is not None else DEFAULT_TEMPLATE)
    shipped = parse_campaign(shipped_text(template), name=template)
    described, section, missing = None, None, []
    signals = read_signals(target) if target is not None else None
    if rig is not None or target is not None or endpoint is not None:
        described = _describe(output, rig or shipped.rig, endpoint)
        if signals is not None and target is not None:
            section, missing = measured_target(
                signals, source=target, folder=file.parent, rig=described, settings=asked
            )
    text = campaign_text(template, path=file, rig=described, target=section)
    if described is not None and target is not None and (pre_test is not None or asked is not None):
        levels = _levels(text, file=file, rig=described, pre_test=pre_test, missing=missing)
        text = campaign_text(template, path=file, rig=described, target=section, levels=levels)
    with replace_when_complete(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
    awaited = file.with_name(AWAITED_TARGET) if target is None and "\n  file: " in text else None
    # A rig that was asked for by name may exist in the lab that runs only.
    asked_at = endpoint_if_any(endpoint) if rig is not None else endpoint
    place = "" if asked_at is None else f" --connect {shlex.quote(asked_at)}"
    command = f"{own_command()} run {shlex.quote(str(file))}{place}"
    lines = [f"{file}: campaign {campaign_name(file)}; run it:  {command}"]
    if target is not None and pre_test is None:
        lines.append("The levels of the identification are not chosen for this target; --pre-test chooses them.")
    if missing:
        lines.append(f"Say under target.channels which channel of {target} is which: {', '.join(missing)}.")
    if awaited is not None and described is not None:
        wanted = ", ".join(channel.name for channel in described.responses)
        lines.append(f"Put its target at {awaited} first: a file of signals with {wanted}.")
    elif absent := missing_target(load_campaign(file), place="the folder of the campaign file"):
        lines.append(f"{absent} Put it there first.")
    output.say(*lines)
    output.document(
        {
            "file": file,
            "campaign": campaign_name(file),
            "rig": described.name if described is not None else shipped.rig,
            "run": command,
            "to_say": missing,
            "target_awaited": awaited,
        }
    )


def _levels(text: str, *, file: Path, rig: Rig, pre_test: Path | None, missing: Sequence[str]) -> PulseLevels | None:
    """Check the target of a campaign's text; return the levels of its identification by a pre-test, if there is one."""
    from duralab.campaign import parse_campaign
    from duralab.target import levels_by_pre_test, make_target

    campaign = parse_campaign(text, name=str(file), folder=file.parent)
    if pre_test is None:
        # A wrong channel or step is said before the file is written.
        if not missing:
            make_target(campaign, rig=rig, vehicle=None, play=None)
        return None
    try:
        return levels_by_pre_test(pre_test, campaign=campaign, rig=rig)
    except InputError as error:
        if not missing or error.field == "pre_test":
            raise
        raise InputError(
            f"--target has no channel {', '.join(missing)}, and levels by a pre-test need one for each response; say "
            "which is which under `channels` of --settings FILE.",
            field="target",
        ) from error


def _describe(output: Output, rig: str, endpoint: str | None) -> Rig:
    """Return the description of a rig: at an endpoint, in the running lab, or in a private one."""
    if endpoint is None:
        with open_lab(output, endpoint_if_any(None), rigs=(rig,)) as lab:
            return lab.describe(rig)
    from duralab.lab import FIND_SECONDS, Lab, join_bus
    from duralab_bus import FaultError

    # A gateway alone answers as well: neither identifier nor recorder is needed yet.
    with join_bus(endpoint) as bus:
        with suppress(FaultError):
            bus.wait_for_live({("rig_sim", rig)}, FIND_SECONDS)
        return Lab(bus, out=Path()).describe(rig)
