"""`python -m operator_page.add_account FILE NAME ROLE`: add or replace an account; the password is read, not given."""

from __future__ import annotations

import argparse
import getpass
import os
import re
import sys
from pathlib import Path

import yaml

from duralab_bus import ConfigError
from operator_page.accounts import HASHER, LONGEST_PASSWORD, NAME_PATTERN, PageRole, read_accounts

SHORTEST_PASSWORD = 10


def main() -> int:
    """Read the password from a terminal, or one line of standard input, and write the file."""
    parser = argparse.ArgumentParser(prog="python -m operator_page.add_account", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE", help="the accounts file; created if missing")
    parser.add_argument("name", metavar="NAME", help="who signs in")
    parser.add_argument("role", choices=[role.value for role in PageRole])
    given = parser.parse_args()
    if not re.fullmatch(NAME_PATTERN, given.name):
        parser.error(f"NAME is {given.name!r}; give letters, digits, spaces, '.', '_' and '-', at most 40.")
    password = getpass.getpass("Password: ") if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
    if not SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        parser.error(f"The password has {len(password)} characters; give {SHORTEST_PASSWORD} to {LONGEST_PASSWORD}.")
    try:
        known = read_accounts(given.file).model_dump(mode="json")["accounts"] if given.file.exists() else {}
    except ConfigError as error:
        parser.error(str(error))
    known[given.name] = {"role": given.role, "password": HASHER.hash(password)}
    part = given.file.with_name(f"{given.file.name}.part")
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as stream:
        yaml.safe_dump({"accounts": known}, stream, sort_keys=True)
    part.replace(given.file)
    return 0


if __name__ == "__main__":
    sys.exit(main())
