"""`python -m operator_page.add_account FILE NAME ROLE`: add or replace an account; the password is read, not given."""

from __future__ import annotations

import argparse
import getpass
import os
import re
import sys
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from duralab_bus import ConfigError
from duralab_settings import dump_yaml, explain_validation
from operator_page.accounts import (
    CERTIFICATE_PATTERN,
    HASHER,
    LONGEST_PASSWORD,
    NAME_PATTERN,
    Accounts,
    PageRole,
    read_accounts,
)

SHORTEST_PASSWORD = 10


def main() -> int:
    """Read the password from a terminal, or one line of standard input, and write the file."""
    parser = argparse.ArgumentParser(prog="python -m operator_page.add_account", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE", help="the accounts file; created if missing")
    parser.add_argument("name", metavar="NAME", help="who signs in")
    parser.add_argument("role", choices=[role.value for role in PageRole])
    parser.add_argument(
        "--certificate", metavar="COMMON_NAME", help="sign in with this certificate of the lab; no password is read"
    )
    given = parser.parse_args()
    if not re.fullmatch(NAME_PATTERN, given.name):
        parser.error(f"NAME is {given.name!r}; give letters, digits, spaces, '.', '_' and '-', at most 40.")
    if given.certificate is not None and not re.fullmatch(CERTIFICATE_PATTERN, given.certificate):
        parser.error(
            f"--certificate is {given.certificate!r}; give operator.NAME or viewer.NAME, as `certs show` does."
        )
    if given.certificate is not None:
        changes = {"certificate": given.certificate}
    else:
        changes = {"password": HASHER.hash(_read_password(parser))}
    try:
        known = (
            read_accounts(given.file).model_dump(mode="json", exclude_none=True)["accounts"]
            if given.file.exists()
            else {}
        )
        known[given.name] = {**known.get(given.name, {}), "role": given.role, **changes}
        Accounts.model_validate({"accounts": known})
    except ConfigError as error:
        parser.error(str(error))
    except ValidationError as error:
        parser.error(explain_validation(error, Accounts).sentence)
    _write(given.file, known)
    return 0


def _read_password(parser: argparse.ArgumentParser) -> str:
    password = getpass.getpass("Password: ") if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        parser.error(f"The password has {len(password)} characters; give {SHORTEST_PASSWORD} to {LONGEST_PASSWORD}.")
    return password


def _write(file: Path, accounts: dict[str, Any]) -> None:
    part = file.with_name(f"{file.name}.part")
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as stream:
        stream.write(dump_yaml({"accounts": accounts}, sort_keys=True))
    part.replace(file)


if __name__ == "__main__":
    sys.exit(main())
