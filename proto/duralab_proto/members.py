"""Members of a secured lab: holders of certificates, with their roles, and rigs or project.

A certificate's common name is `<role>.<name>`. The holder's rigs or project are URIs in its alternative names, so that
a session can derive its rights at the router.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Self

from duralab_proto.keys import KeyNameError, check_project, check_rig


class Role(StrEnum):
    """Role of a certificate's holder in the lab."""

    RIG = "rig"
    """Plays drives: the simulation, or the gateway to a real rig."""
    IDENTIFIER = "identifier"
    ITERATOR = "iterator"
    SEQUENCER = "sequencer"
    RECORDER = "recorder"
    OPERATOR = "operator"
    """A person or script that runs the lab: plays, starts and stops campaigns, clears latches."""
    VIEWER = "viewer"
    """A person or script with read access only."""


ROUTER: Final = "router"
"""Role of the router's certificate; no client may use it."""

ADMIN: Final = "admin"
"""Role that reads the router's metrics, from the router's machine only."""

MEMBER_ROLES: Final = (*(role.value for role in Role), ROUTER, ADMIN)

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,57}")
_BINDING: Final = "urn:duralab:"


class MemberError(ValueError):
    """A value does not name a member of a lab; the message is one sentence."""


@dataclass(frozen=True)
class Member:
    """Member of a lab, the holder of one certificate.

    Parameters
    ----------
    role : str
        A `Role`, `ROUTER`, or `ADMIN`, the reader of the router's metrics on the router's machine.
    name : str
        Name in lower case letters, digits, '-' and '_', at most 58 characters.
    rigs : tuple of str
        Rigs that a member of role rig serves, at least one; rigs that an operator may move, all if empty.
    project : str
        Project whose recordings and campaigns a viewer may read; all projects if empty.
    """

    role: str
    name: str
    rigs: tuple[str, ...] = ()
    project: str = ""

    def __post_init__(self) -> None:
        if self.role not in MEMBER_ROLES:
            raise MemberError(f"The role {self.role!r} is not one of {', '.join(MEMBER_ROLES)}.")
        if _NAME.fullmatch(self.name) is None:
            raise MemberError(
                f"The member's name {self.name!r} must consist of lower case letters, digits, '-' and '_', "
                "starting with a letter or digit, at most 58 characters."
            )
        try:
            for rig in self.rigs:
                check_rig(rig)
            if self.project:
                check_project(self.project)
        except KeyNameError as error:
            raise MemberError(f"{self.common_name}: {error}") from error
        self._check_bindings()

    def _check_bindings(self) -> None:
        who = self.common_name
        if len(set(self.rigs)) < len(self.rigs):
            raise MemberError(f"{who} names a rig twice: {', '.join(self.rigs)}; name each once.")
        if self.role == Role.RIG and not self.rigs:
            raise MemberError(f"{who} names no rigs; list those it speaks for, such as [front_axle].")
        if self.rigs and self.role not in (Role.RIG, Role.OPERATOR):
            raise MemberError(f"{who} names rigs; only members of role rig or operator are bound to rigs.")
        if self.project and self.role != Role.VIEWER:
            raise MemberError(f"{who} names a project; only a viewer is bound to one.")

    @property
    def common_name(self) -> str:
        """Common name, `<role>.<name>`."""
        return f"{self.role}.{self.name}"

    @property
    def bindings(self) -> tuple[str, ...]:
        """URIs in the certificate with the member's rigs or project."""
        rigs = tuple(f"{_BINDING}rig:{rig}" for rig in self.rigs)
        return (*rigs, f"{_BINDING}project:{self.project}") if self.project else rigs

    @classmethod
    def parse(cls, common_name: str, bindings: Iterable[str] = ()) -> Self:
        """Return the member that a certificate names.

        Parameters
        ----------
        common_name : str
            `<role>.<name>`.
        bindings : iterable of str
            URIs, as in the property `bindings`.

        Raises
        ------
        MemberError
            `common_name` is not `<role>.<name>`, or a URI is not a binding of that role.
        """
        role, dot, name = common_name.partition(".")
        if not dot:
            raise MemberError(f"The common name {common_name!r} is not of the form '<role>.<name>'.")
        rigs: list[str] = []
        projects: list[str] = []
        for uri in bindings:
            kind, colon, bound_to = uri.removeprefix(_BINDING).partition(":")
            if not uri.startswith(_BINDING) or not colon or kind not in ("rig", "project"):
                raise MemberError(
                    f"The name {uri!r} in the certificate of {common_name} binds it to no rig or project."
                )
            (rigs if kind == "rig" else projects).append(bound_to)
        if len(projects) > 1:
            raise MemberError(f"{common_name} names {len(projects)} projects; one is allowed.")
        return cls(role, name, tuple(rigs), *projects)
