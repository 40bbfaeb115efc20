"""Members of a lab in a YAML file: names, roles, and rigs or project.

Certificates and the router's access control are made from it. The router refuses a member that was removed from the
file, even if its certificate is still valid.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final, Self

from pydantic import Field, model_validator

from duralab.errors import InputError
from duralab_bus import ConfigError, load_config
from duralab_proto.members import MEMBER_ROLES, ROUTER, Member, Role
from duralab_settings import Section

_MOST_MEMBERS: Final = 1000


class MemberEntry(Section):
    """Entry of one member in the file."""

    role: str = Field(description=f"One of {', '.join(MEMBER_ROLES)}.")
    name: str = Field(description="With the role it is the common name of the certificate, e.g. operator.anna.")
    rigs: tuple[str, ...] = Field(
        default=(),
        strict=False,
        description="Rigs that a member of role rig speaks for; rigs that an operator may move, all if left out.",
    )
    project: str = Field(default="", description="Project whose recordings a viewer may read; of all if left out.")
    hosts: tuple[str, ...] = Field(
        default=(),
        strict=False,
        description="Names and addresses by which a router is reached; this machine if left out.",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        member = self.member
        if self.hosts and self.role != ROUTER:
            raise ValueError(f"{member.common_name} names hosts; only a router is reached by others, so leave them out")
        return self

    @property
    def member(self) -> Member:
        """Member; raises ValueError with one sentence if the entry is not allowed."""
        return Member(self.role, self.name, self.rigs, self.project)


class MembersFile(Section):
    """Members of one lab: unique names, one router, one member for each rig."""

    members: tuple[MemberEntry, ...] = Field(strict=False, max_length=_MOST_MEMBERS, description="All of them.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        members = [entry.member for entry in self.members]
        for name, count in Counter(member.common_name for member in members).items():
            if count > 1:
                raise ValueError(f"{name} is listed {count} times; list each member once")
        speakers = [(rig, member.common_name) for member in members if member.role == Role.RIG for rig in member.rigs]
        for rig, count in Counter(rig for rig, _ in speakers).items():
            if count > 1:
                names = " and ".join(name for named, name in speakers if named == rig)
                raise ValueError(f"{names} both speak for rig {rig!r}; one rig has one member")
        if (routers := sum(member.role == ROUTER for member in members)) != 1:
            raise ValueError(f"{routers} routers are listed; one is needed")
        return self


def read_members(path: Path) -> tuple[MemberEntry, ...]:
    """Return the members in a file.

    Parameters
    ----------
    path : Path
        YAML file with a list `members`; each has `role` and `name`, and may have `rigs`, `project` or `hosts`.

    Returns
    -------
    tuple of MemberEntry
        Members in the order of the file: exactly one router, unique names, no rig of two members.

    Raises
    ------
    InputError
        The file cannot be read or is not YAML, or a key or value is not allowed.
    """
    try:
        return load_config(MembersFile, path).members
    except ConfigError as error:
        raise InputError(str(error), field="members") from error
