"""Who may sign in: a file of names, roles and hashes of passwords."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError
from pydantic import AfterValidator, BaseModel, ConfigDict, StringConstraints

from duralab_bus import load_config

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}$"
LONGEST_PASSWORD = 200
HASHER = PasswordHasher()
_NO_ACCOUNT = HASHER.hash("of nobody")


class PageRole(StrEnum):
    """What a person may do at the page."""

    VIEWER = "viewer"
    OPERATOR = "operator"


def _check_hash(text: str) -> str:
    try:
        HASHER.check_needs_rehash(text)
    except (InvalidHashError, ValueError):
        raise ValueError("is no hash of argon2; let `python -m operator_page.add_account` write the file") from None
    return text


class Account(BaseModel):
    """One person."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    role: PageRole
    # Hash of the password, as argon2 writes it.
    password: Annotated[str, AfterValidator(_check_hash)]


class Accounts(BaseModel):
    """Content of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    accounts: dict[Annotated[str, StringConstraints(pattern=NAME_PATTERN)], Account]

    def role_of(self, name: str, password: str) -> PageRole | None:
        """Return the role of who knows the password of a name; None for all others, after the same time."""
        account = self.accounts.get(name)
        try:
            HASHER.verify(account.password if account is not None else _NO_ACCOUNT, password)
        except Argon2Error:
            return None
        return account.role if account is not None else None


def read_accounts(path: Path) -> Accounts:
    """Read the file; raises ConfigError with a sentence where it does not fit."""
    return load_config(Accounts, path)
