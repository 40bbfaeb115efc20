"""Members of the lab that the tests secure: one of each role, and those that are bound to a rig or a project."""

from __future__ import annotations

from pathlib import Path

from duralab.security import MemberEntry, configure_router, init_authority, issue_missing
from duralab_proto.members import ADMIN, ROUTER, Member, Role

RIG = "front_axle_compliant"
"""The rig that is really served in these tests."""

PROJECT = "wheel"

MEMBERS = (
    # `main` of each role may do all that the role may: it is the other side of what the others try.
    MemberEntry(role=Role.RIG, name="main", rigs=("a", "b", "predecessor", RIG)),
    MemberEntry(role=Role.RIG, name="front", rigs=("a",)),
    MemberEntry(role=Role.IDENTIFIER, name="main"),
    MemberEntry(role=Role.ITERATOR, name="main"),
    MemberEntry(role=Role.SEQUENCER, name="main"),
    MemberEntry(role=Role.RECORDER, name="main"),
    MemberEntry(role=Role.OPERATOR, name="main"),
    MemberEntry(role=Role.OPERATOR, name="ben", rigs=("a",)),
    MemberEntry(role=Role.VIEWER, name="main"),
    MemberEntry(role=Role.VIEWER, name="guest", project=PROJECT),
)

TRIED: tuple[Member, ...] = tuple(entry.member for entry in MEMBERS)

CONFIGURATION_FILE = "zenohd.json5"


def secured_folder(folder: Path) -> Path:
    """Fill a folder with the certificates of all members, and the configuration of a router that knows them."""
    members = (*MEMBERS, MemberEntry(role=ROUTER, name="main"), MemberEntry(role=ADMIN, name="main"))
    init_authority(folder)
    issue_missing(folder, members)
    configuration = configure_router(folder, members, certificates=str(folder))
    (folder / CONFIGURATION_FILE).write_text(configuration, encoding="utf-8")
    return folder
