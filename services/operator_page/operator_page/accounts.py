"""Accounts of the page: a file of names, roles, hashes of passwords and names of certificates."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Self

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError
from pydantic import AfterValidator, BaseModel, ConfigDict, StringConstraints, model_validator

from duralab_bus import load_config

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}$"
# Only for people: signing in is not possible with a service's certificate.
CERTIFICATE_PATTERN = r"^(operator|viewer)\.[a-z0-9][a-z0-9_-]{0,57}$"
LONGEST_PASSWORD = 200
HASHER = PasswordHasher()
_NO_ACCOUNT = HASHER.hash("of nobody")


class PageRole(StrEnum):
    """Role of a person at the page."""

    VIEWER = "viewer"
    OPERATOR = "operator"


def _check_hash(text: str) -> str:
    try:
        HASHER.check_needs_rehash(text)
    except (InvalidHashError, ValueError):
        raise ValueError("is no hash of argon2; let `python -m operator_page.add_account` write the file") from None
    return text


class Account(BaseModel):
    """One person, who signs in with a password, a certificate or either."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    role: PageRole
    # Password hash in the format of argon2.
    password: Annotated[str, AfterValidator(_check_hash)] | None = None
    # Common name of a certificate of the lab.
    certificate: Annotated[str, StringConstraints(pattern=CERTIFICATE_PATTERN)] | None = None

    @model_validator(mode="after")
    def _check_ways(self) -> Self:
        if self.password is None and self.certificate is None:
            raise ValueError("has neither password nor certificate; give one of them, or both")
        if self.role is PageRole.OPERATOR and (self.certificate or "").startswith("viewer."):
            raise ValueError(f"is an operator with the certificate {self.certificate}; give one of an operator")
        return self


class Accounts(BaseModel):
    """Content of the accounts file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    accounts: dict[Annotated[str, StringConstraints(pattern=NAME_PATTERN)], Account]

    @model_validator(mode="after")
    def _check_certificates(self) -> Self:
        owners: dict[str, str] = {}
        for name, account in self.accounts.items():
            if account.certificate is not None and (other := owners.setdefault(account.certificate, name)) != name:
                raise ValueError(f"{other} and {name} have the certificate {account.certificate}; give each its own")
        return self

    @property
    def certificates(self) -> dict[str, str]:
        """Names of the accounts with a certificate, by its common name."""
        return {one.certificate: name for name, one in self.accounts.items() if one.certificate is not None}

    def role_of(self, name: str, password: str) -> PageRole | None:
        """Return the role for a name and its password; None if they do not match, after the same time."""
        account = self.accounts.get(name)
        try:
            HASHER.verify((account and account.password) or _NO_ACCOUNT, password)
        except Argon2Error:
            return None
        return account.role if account is not None and account.password is not None else None


def read_accounts(path: Path) -> Accounts:
    """Read the accounts file; raises ConfigError with a sentence if it is invalid."""
    return load_config(Accounts, path)
