"""`duralab certs` and `duralab router`: certificates, a router for them, and what a router refused."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from duralab.cli.ending import ExitCode
from duralab.cli.options import Json, Replace
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.security import CertificateFile

FOLDER = Path("certificates")
Folder = Annotated[Path, typer.Option("--folder", metavar="DIR", help="Folder of the certificates.")]
LabName = Annotated[str, typer.Option("--lab", metavar="NAME", help="Name of the lab.")]
MEMBERS = Path("members.yaml")
Members = Annotated[Path, typer.Option("--members", metavar="FILE", help="File of the lab's members.")]
_EXPIRES_SOON_DAYS = 30.0
_WATCH_SECONDS = 0.25


def init(folder: Folder = FOLDER, lab: LabName = "local", as_json: Json = False) -> None:
    """Make the certificate authority of a lab: ca.crt and ca.key."""
    from duralab import security

    made = security.init_authority(folder, lab=lab)
    output = Output(as_json)
    _tell(output, made, "made")
    output.say(
        f"{made.key} makes anybody a member of this lab: keep it where certificates are issued, and nowhere else."
    )


def issue(
    members: Members = MEMBERS,
    *,
    days: Annotated[int, typer.Option("--days", min=1, metavar="N", help="Validity of the certificates.")] = 365,
    folder: Folder = FOLDER,
    as_json: Json = False,
) -> None:
    """Issue a certificate with a new private key to every member without one."""
    from duralab import security

    issued = security.issue_missing(folder, security.read_members(members), days=days)
    output = Output(as_json)
    for file in issued:
        _say(output, file, "issued")
    if not issued:
        output.say(f"Every member in {members} has its certificate in {folder}.")
    output.document([_as_json(file) for file in issued])


def renew(
    name: Annotated[str, typer.Argument(metavar="ROLE.NAME", help="Common name, e.g. operator.anna; or ca.")],
    days: Annotated[int | None, typer.Option("--days", min=1, metavar="N", help="Validity of the certificate.")] = None,
    folder: Folder = FOLDER,
    members: Members = MEMBERS,
    as_json: Json = False,
) -> None:
    """Replace a certificate and its key by new ones of the same name, as the file of members now says."""
    from duralab import security

    listed = () if name == security.AUTHORITY else security.read_members(members)
    _tell(Output(as_json), security.renew(folder, name, members=listed, days=days), "renewed")


def show(folder: Folder = FOLDER, as_json: Json = False) -> None:
    """List the certificates of a folder with their expiry; exit code 1 if one has expired."""
    from rich.table import Table

    from duralab.security import read_certificates

    files = read_certificates(folder)
    output = Output(as_json)
    if not output.document([_as_json(file) for file in files]):
        table = Table("name", "expires", "days left", "bound to", "SHA-256", box=None, pad_edge=False)
        for file in files:
            days = file.days_left()
            left = f"{days:.0f}" if days >= 0 else "expired"
            style = "bold red" if days < 0 else "yellow" if days < _EXPIRES_SOON_DAYS else None
            table.add_row(
                file.name,
                f"{file.expires:%Y-%m-%d %H:%M} UTC",
                left,
                ", ".join(_bound_to(file)),
                f"{file.fingerprint[:16]}…",
                style=style,
            )
        output.console.print(table)
    if any(file.days_left() < 0 for file in files):
        raise typer.Exit(int(ExitCode.FAILED))


def router(
    folder: Folder = FOLDER,
    *,
    members: Members = MEMBERS,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file to write; printed if left out.")
    ] = None,
    certificates: Annotated[
        str | None,
        typer.Option(
            "--certificates", metavar="DIR", help="Folder of the certificates on the router; as --folder if left out."
        ),
    ] = None,
    port: Annotated[int, typer.Option("--port", metavar="N", min=1, max=65535, help="Port of the router.")] = 7447,
    lab: LabName = "local",
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write the configuration of a router that admits the members of the lab, each on its own keys."""
    from duralab import security
    from duralab.output_files import replace_when_complete, require_outputs

    output = Output(as_json)
    listed = security.read_members(members)
    place = certificates or str(folder.resolve())
    content = security.configure_router(folder, listed, lab=lab, certificates=place, port=port)
    if out is None:
        if not output.document({"configuration": content}):
            sys.stdout.write(content)
        return
    require_outputs([out], replace=replace)
    with replace_when_complete(out) as temporary:
        temporary.write_text(content, encoding="utf-8")
    output.say(f"{out} written; start the router with `zenohd --config {out}`, or try it with `duralab router`.")
    output.document({"configuration_file": out})


def run_router(
    folder: Folder = FOLDER,
    *,
    members: Members = MEMBERS,
    host: Annotated[
        str, typer.Option("--host", metavar="ADDRESS", help="Address to listen on; 0.0.0.0 to accept other machines.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", metavar="N", min=1, max=65535, help="Port to listen on.")] = 7447,
    lab: LabName = "local",
    as_json: Json = False,
) -> None:
    """Run the router of a secured lab until Ctrl-C, to try one without zenohd."""
    import duralab_bus
    from duralab import security
    from duralab_bus import BusError
    from duralab_proto.members import ROUTER

    output = Output(as_json)
    listed = security.read_members(members)
    content = security.configure_router(folder, listed, lab=lab, certificates=str(folder.resolve()), port=port)
    endpoint = f"tls/{f'[{host}]' if ':' in host else host}:{port}"
    names = sorted(entry.member.common_name for entry in listed if entry.role != ROUTER)
    try:
        with duralab_bus.run_router(content, listen=endpoint):
            output.say(
                f"The router of lab {lab} listens at {endpoint} and lets in {', '.join(names)}, each on its own keys. "
                "Ctrl-C ends it."
            )
            output.document({"endpoint": endpoint, "lab": lab, "members": names}, on_one_line=True)
            while True:
                time.sleep(_WATCH_SECONDS)
    except BusError as error:
        sentence = str(error)
        # What Zenoh says itself has neither a full stop nor a remedy.
        if not sentence.endswith("."):
            sentence = f"{sentence}; give a --host of this machine, or another --port."
        raise InputError(sentence) from error


def refusals(
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="A router's log; standard input if left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object for each refusal.")] = False,
) -> None:
    """List what a router refused and to whom, from its log (see docs/security.md)."""
    from duralab.security import read_refusals

    output = Output(as_json)
    with ExitStack() as stack:
        try:
            lines = sys.stdin if log is None else stack.enter_context(log.open(encoding="utf-8", errors="replace"))
        except OSError as error:
            raise InputError(f"The log {log} cannot be read: {error.strerror}; give a router's log.") from error
        for refusal in read_refusals(lines):
            if not output.document({"event": "refused", **asdict(refusal)}, on_one_line=True):
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
        "rigs": list(file.member.rigs) if file.member else [],
        "project": file.member.project if file.member else "",
        "sha256": file.fingerprint,
    }


def _bound_to(file: CertificateFile) -> tuple[str, ...]:
    bound = () if file.member is None else (*file.member.rigs, file.member.project)
    return (*file.hosts, *filter(None, bound))


def _say(output: Output, file: CertificateFile, what: str) -> None:
    output.say(f"{file.path} and {file.key} {what}, valid until {file.expires:%Y-%m-%d %H:%M} UTC.")


def _tell(output: Output, file: CertificateFile, what: str) -> None:
    _say(output, file, what)
    output.document(_as_json(file))
