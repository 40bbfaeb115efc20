"""Target file that a campaign needs and that is not on this machine."""

from __future__ import annotations

from typing import Final

from duralab.campaign.file import Campaign

_SOURCES: Final = {
    "belgian_block.crg": "crg-bin/belgian_block.crg of ASAM OpenCRG at revision 70bb926, https://github.com/asam-ev/OpenCRG"
}
"""Source of each file that a shipped campaign needs and that does not ship."""


def missing_target(campaign: Campaign, *, place: str) -> str:
    """Return which file of a campaign's target is missing, and where to get it.

    Parameters
    ----------
    campaign : Campaign
        Campaign with its folder, where a relative path starts.
    place : str
        Words for that folder, e.g. "this folder".

    Returns
    -------
    str
        One sentence; empty if the file exists, or the target needs none.
    """
    target = campaign.target
    path = target.file if target.opencrg is None else target.opencrg.path
    if path is None or (campaign.folder / path).exists():
        return ""
    kind = "target file" if target.opencrg is None else "road"
    source = f"; it is {_SOURCES[path.name]}" if path.name in _SOURCES else ""
    return f"Its {kind} {path} is missing{'' if path.is_absolute() else f' in {place}'}{source}."
