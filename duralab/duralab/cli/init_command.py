"""`duralab init`: a campaign file to begin with."""

from __future__ import annotations

import shlex
from pathlib import Path

from duralab._outputs import replace_when_complete, require_free, require_other
from duralab.campaign_loading import parse_campaign
from duralab.campaign_template import campaign_name, campaign_text, measured_target, shipped_text
from duralab.cli.choosing_lab import endpoint_if_any, open_lab
from duralab.cli.json_output import console_beside, write_json
from duralab.cli.opening import own_command


def init(file: Path, *, template: str, target: Path | None, replace: bool, as_json: bool) -> None:
    """Write a campaign file and say how to run it."""
    console = console_beside(as_json)
    require_other([file], read=[target] if target is not None else [])
    require_free([file], replace=replace)
    section, missing = None, []
    if target is not None:
        from duralab.formats import read_signals

        signals = read_signals(target)
        rig = parse_campaign(shipped_text(template), name=template).rig
        with console.status("Asking for the rig's responses …"), open_lab(endpoint_if_any(None), rigs=(rig,)) as lab:
            described = lab.describe(rig)
        section, missing = measured_target(signals, source=target, folder=file.parent, rig=described)
    text = campaign_text(template, path=file, target=section)
    with replace_when_complete(file) as temporary:
        temporary.write_text(text, encoding="utf-8")
    command = f"{own_command()} run {shlex.quote(str(file))}"
    console.print(f"{file}: campaign {campaign_name(file)}; run it:  {command}", highlight=False, markup=False)
    if missing:
        console.print(
            f"Say under target.channels which channel of {target} is which: {', '.join(missing)}.",
            highlight=False,
            markup=False,
        )
    if as_json:
        write_json({"file": file, "campaign": campaign_name(file), "run": command, "to_say": missing})
