"""What `duralab certs` and `duralab router` do: certificates, a router for them, and what a router refused."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table

import labbus
from duralab import security
from duralab.cli.exit_codes import ExitCode
from duralab.cli.json_output import console_beside, write_json
from duralab.errors import InputError
from duralab.security import AUTHORITY, CertificateFile, read_certificates, read_refusals
from duralab_proto.access import ROUTER
from labbus import BusError

_EXPIRES_SOON_DAYS = 30.0
_WATCH_SECONDS = 0.25


def init(folder: Path, *, lab: str, as_json: bool) -> None:
    """Make the authority of a lab."""
    made = security.init_authority(folder, lab=lab)
    _tell(made, "made", as_json=as_json)
    _print(
        f"{made.key} makes anybody a member of this lab: keep it where certificates are issued, and nowhere else.",
        as_json=as_json,
    )


def issue(folder: Path, role: str, name: str, *, hosts: Sequence[str], days: int, as_json: bool) -> None:
    """Issue a certificate."""
    _tell(security.issue(folder, role, name, hosts=hosts, days=days), "issued", as_json=as_json)


def renew(folder: Path, name: str, *, days: int | None, as_json: bool) -> None:
    """Renew a certificate, or the authority."""
    _tell(security.renew(folder, name, days=days), "renewed", as_json=as_json)


def show(folder: Path, *, as_json: bool) -> None:
    """List the certificates of a folder.

    Raises
    ------
    typer.Exit
        With code 1 where one has expired.
    """
    files = read_certificates(folder)
    if as_json:
        write_json([_as_json(file) for file in files])
    else:
        table = Table("name", "expires", "days left", "hosts", "SHA-256", box=None, pad_edge=False)
        for file in files:
            days = file.days_left()
            left = f"{days:.0f}" if days >= 0 else "expired"
            style = "bold red" if days < 0 else "yellow" if days < _EXPIRES_SOON_DAYS else None
            table.add_row(
                file.name,
                f"{file.expires:%Y-%m-%d %H:%M} UTC",
                left,
                ", ".join(file.hosts),
                f"{file.fingerprint[:16]}…",
                style=style,
            )
        Console(soft_wrap=True).print(table)
    if any(file.days_left() < 0 for file in files):
        raise typer.Exit(int(ExitCode.FAILED))


def router(
    folder: Path,
    *,
    out: Path | None,
    certificates: str | None,
    port: int,
    lab: str,
    replace: bool,
    as_json: bool,
) -> None:
    """Write the configuration of a router."""
    content = security.configure_router(folder, lab=lab, certificates=certificates or str(folder.resolve()), port=port)
    if out is None:
        if as_json:
            write_json({"configuration": content})
        else:
            sys.stdout.write(content)
        return
    try:
        with out.open("w" if replace else "x", encoding="utf-8") as stream:
            stream.write(content)
    except FileExistsError as error:
        raise InputError(f"{out} is there already; say --replace to overwrite it.") from error
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}.") from error
    _print(
        f"{out} written; start the router with `zenohd --config {out}`, or try it with `duralab router`.",
        as_json=as_json,
    )
    if as_json:
        write_json({"configuration_file": out})


def run_router(folder: Path, *, host: str, port: int, lab: str, as_json: bool) -> None:
    """Run a router for the certificates of a folder until it is interrupted, and say where it listens."""
    content = security.configure_router(folder, lab=lab, certificates=str(folder.resolve()), port=port)
    endpoint = f"tls/{f'[{host}]' if ':' in host else host}:{port}"
    names = [file.name for file in read_certificates(folder)]
    members = [name for name in names if name != AUTHORITY and not name.startswith(f"{ROUTER}.")]
    try:
        with labbus.run_router(content, listen=endpoint):
            _print(
                f"The router of lab {lab} listens at {endpoint} and lets in {', '.join(members)}, each by its role. "
                "Ctrl-C ends it.",
                as_json=as_json,
            )
            if as_json:
                write_json({"endpoint": endpoint, "lab": lab, "members": members}, on_one_line=True)
            while True:
                time.sleep(_WATCH_SECONDS)
    except BusError as error:
        raise InputError(str(error)) from error


def refusals(log: Path | None, *, as_json: bool) -> None:
    """Tell whom a router refused what."""
    with ExitStack() as stack:
        try:
            lines = sys.stdin if log is None else stack.enter_context(log.open(encoding="utf-8", errors="replace"))
        except OSError as error:
            raise InputError(f"The log {log} cannot be read: {error.strerror}.") from error
        for refusal in read_refusals(lines):
            if as_json:
                write_json({"event": "refused", **asdict(refusal)}, on_one_line=True)
            else:
                who = refusal.who or "somebody unknown"
                session = f" (session {refusal.session})" if refusal.session else ""
                sys.stdout.write(f"{refusal.time} {who}{session}: {refusal.what}: {refusal.key}\n")
                sys.stdout.flush()


def _as_json(file: CertificateFile) -> dict[str, object]:
    return {
        "name": file.name,
        "certificate": str(file.path),
        "begins": file.begins.isoformat(),
        "expires": file.expires.isoformat(),
        "days_left": round(file.days_left(), 2),
        "hosts": list(file.hosts),
        "sha256": file.fingerprint,
    }


def _tell(file: CertificateFile, what: str, *, as_json: bool) -> None:
    _print(f"{file.path} and {file.key} {what}, valid until {file.expires:%Y-%m-%d %H:%M} UTC.", as_json=as_json)
    if as_json:
        write_json(_as_json(file))


def _print(sentence: str, *, as_json: bool) -> None:
    console_beside(as_json).print(sentence, highlight=False, markup=False)
