"""Whether the services reach each other on loopback, and whether the usual ports are free."""

from __future__ import annotations

import socket
from collections.abc import Collection
from typing import Final

from duralab.diagnosis.finding import Finding, fine, problem, warning
from duralab.processes import GRPC_PORT, WEB_PORT
from duralab_bus import BusConfig, BusError, open_bus

LAB_PORT: Final = 7474
LOOPBACK: Final = "127.0.0.1"


def check_bus() -> Finding:
    """Judge whether two sessions on loopback find each other."""
    try:
        with (
            open_bus(BusConfig(), service="duralab") as first,
            open_bus(BusConfig(connect=first.listening[:1]), service="duralab"),
        ):
            return fine("bus", f"two sessions met at {first.listening[0]}")
    except BusError as error:
        return problem("bus", str(error), f"Let programs on this machine connect to {LOOPBACK} (firewall, container).")


def check_ports(labs: Collection[str], *, is_free: dict[int, bool]) -> list[Finding]:
    """Judge the ports that `duralab up` and the viewer take where nothing else is said."""
    findings = []
    if is_free[LAB_PORT]:
        findings.append(fine("lab's port", f"{LAB_PORT} is free"))
    elif any(endpoint.endswith(f":{LAB_PORT}") for endpoint in labs):
        findings.append(fine("lab's port", f"{LAB_PORT} is that of your lab, which runs"))
    else:
        findings.append(
            problem(
                "lab's port",
                f"The port {LAB_PORT} is in use by another program, or by another user's lab.",
                f"End that one, or choose another: `duralab up --listen tcp/{LOOPBACK}:7475`.",
            )
        )
    taken = [port for port in (GRPC_PORT, WEB_PORT) if not is_free[port]]
    if taken:
        findings.append(
            warning(
                "viewer's ports",
                f"In use: {', '.join(str(port) for port in taken)}; another viewer may be open.",
                "Close it, or choose others: `duralab view --port 0 --web-port 0` (--view does so by itself).",
            )
        )
    else:
        findings.append(fine("viewer's ports", f"{GRPC_PORT} and {WEB_PORT} are free"))
    return findings


def ports_free() -> dict[int, bool]:
    """Return for each of the usual ports whether it can be listened on."""
    return {port: _is_free(port) for port in (LAB_PORT, GRPC_PORT, WEB_PORT)}


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        # As the programs do: what a connection left behind some seconds ago is in nobody's way.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
    return True
