"""`duralab router`, and `duralab certs init`, `issue`, `renew`, `show`, `router` and `refusals`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Json, Replace

Folder = Annotated[Path, typer.Option("--folder", metavar="DIR", help="Where the certificates are.")]
LabName = Annotated[str, typer.Option("--lab", metavar="NAME", help="Name of the lab.")]
FOLDER = Path("certificates")


def run_router(
    folder: Folder = FOLDER,
    *,
    host: Annotated[
        str, typer.Option("--host", metavar="ADDRESS", help="Where it listens; 0.0.0.0 for other machines too.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Where it listens.")] = 7447,
    lab: LabName = "local",
    as_json: Json = False,
) -> None:
    """Run the router of a secured lab from Python, to try one without zenohd, until Ctrl-C."""
    from duralab.cli.certs_command import run_router as run

    run(folder, host=host, port=port, lab=lab, as_json=as_json)


def init(folder: Folder = FOLDER, lab: LabName = "local", as_json: Json = False) -> None:
    """Make the certificate authority of a lab: ca.crt and ca.key."""
    from duralab.cli.certs_command import init as make

    make(folder, lab=lab, as_json=as_json)


def issue(
    role: Annotated[
        str, typer.Argument(help="router, rig, identifier, iterator, recorder, operator, viewer or admin.")
    ],
    name: Annotated[str, typer.Argument(help="Who it is, e.g. main or anna; with the role it is the common name.")],
    *,
    host: Annotated[
        list[str] | None,
        typer.Option("--host", metavar="HOST", help="Name or address of a router; give it again for more of them."),
    ] = None,
    days: Annotated[int, typer.Option("--days", min=1, metavar="N", help="How long it is valid.")] = 365,
    folder: Folder = FOLDER,
    as_json: Json = False,
) -> None:
    """Issue a certificate with a private key of its own."""
    from duralab.cli.certs_command import issue as make

    make(folder, role, name, hosts=host or [], days=days, as_json=as_json)


def renew(
    name: Annotated[str, typer.Argument(metavar="ROLE.NAME", help="Common name, e.g. operator.anna; or ca.")],
    days: Annotated[int | None, typer.Option("--days", min=1, metavar="N", help="How long it is valid.")] = None,
    folder: Folder = FOLDER,
    as_json: Json = False,
) -> None:
    """Take the place of a certificate and its key by new ones of the same name."""
    from duralab.cli.certs_command import renew as make

    make(folder, name, days=days, as_json=as_json)


def show(folder: Folder = FOLDER, as_json: Json = False) -> None:
    """List the certificates of a folder with their expiry; exit code 1 where one has expired."""
    from duralab.cli.certs_command import show as list_them

    list_them(folder, as_json=as_json)


def router(
    folder: Folder = FOLDER,
    *,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Where to; printed if left out.")] = None,
    certificates: Annotated[
        str | None,
        typer.Option("--certificates", metavar="DIR", help="Where the router finds its own; as --folder if left out."),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Where the router listens.")] = 7447,
    lab: LabName = "local",
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Write the configuration of a router that lets in whose certificates are in the folder, each by its role."""
    from duralab.cli.certs_command import router as configure

    configure(folder, out=out, certificates=certificates, port=port, lab=lab, replace=replace, as_json=as_json)


def refusals(
    log: Annotated[Path | None, typer.Argument(help="A router's log; standard input if left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object for each, as they come.")] = False,
) -> None:
    """Tell whom a router refused what, from its log (docs/security.md says how it logs that)."""
    from duralab.cli.certs_command import refusals as tell

    tell(log, as_json=as_json)
