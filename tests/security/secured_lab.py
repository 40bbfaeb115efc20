"""Services of a lab as processes, each with a certificate of its own, behind a secured router."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml

from duralab_bus import Bus, BusConfig, BusMode, TlsConfig, open_bus

ROLES: Mapping[str, str] = {
    "rig_sim": "rig",
    "identifier": "identifier",
    "iterator": "iterator",
    "sequencer": "sequencer",
    "recorder": "recorder",
}
"""Role in the certificate of each service."""

START_SECONDS = 120.0
_END_SECONDS = 5.0


def secured_bus(endpoint: str, certificates: Path, name: str) -> Bus:
    """Join with a certificate of a folder."""
    config = BusConfig(
        mode=BusMode.CLIENT,
        connect=(endpoint,),
        connect_timeout_seconds=30.0,
        tls=TlsConfig.of(certificates / name),
    )
    return open_bus(config, service="security")


@contextmanager
def running(
    services: Mapping[str, Mapping[str, Any]],
    *,
    endpoint: str,
    certificates: Path,
    folder: Path,
    wanted: Sequence[tuple[str, str]],
) -> Iterator[Bus]:
    """Start services and yield the session of an operator, when all that is wanted is live.

    Parameters
    ----------
    services : mapping
        Settings of each service to start, beside `bus`.
    endpoint : str
        Of the router.
    certificates : Path
        With a pair `<role>.main` for each.
    folder : Path
        Of configurations and logs, `<service>.log`.
    wanted : sequence of (service, instance)
        Who has to be there.
    """
    with ExitStack() as stack:
        for name, settings in services.items():
            tls = TlsConfig.of(certificates / f"{ROLES[name]}.main").model_dump(mode="json")
            bus: dict[str, Any] = {"mode": "client", "connect": [endpoint], "connect_timeout_seconds": 60.0, "tls": tls}
            config = folder / f"{name}.yaml"
            config.write_text(
                yaml.safe_dump({"exit_with_parent": True, **settings, "bus": {**bus, **settings.get("bus", {})}})
            )
            log = stack.enter_context((folder / f"{name}.log").open("ab"))
            process = subprocess.Popen(
                [sys.executable, "-m", name, "--config", str(config)],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
            stack.callback(_end, process)
        operator = stack.enter_context(secured_bus(endpoint, certificates, "operator.main"))
        operator.wait_for_live(set(wanted), START_SECONDS)
        yield operator


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(_END_SECONDS)
    process.kill()
    process.wait()
    assert process.stdin is not None
    process.stdin.close()
