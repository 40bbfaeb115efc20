"""Health check of a service: `python -m duralab_bus.health SERVICE [INSTANCE …] [--config FILE]`.

For health checks of containers and supervisors: joins the bus with the service's own configuration and queries
the health of each instance. Exit code 0, or 1 with one sentence; 2 for a wrong configuration.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict

from duralab_bus.bus import open_bus
from duralab_bus.faults import BusError, FaultError
from duralab_bus.session import BusConfig, BusMode
from duralab_bus.yaml_config import ConfigError, configured
from duralab_proto.keys import MAIN_INSTANCE
from duralab_proto.v1 import health_pb2

EXIT_SICK: Final = 1
EXIT_MISCONFIGURED: Final = 2


class _Joining(BaseModel):
    """Bus section of a service's configuration."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    bus: BusConfig = BusConfig()


def check_health(bus: BusConfig, service: str, instances: list[str], *, timeout_seconds: float) -> None:
    """Query instances of a service for their health."""
    client = bus.model_copy(update={"mode": BusMode.CLIENT, "connect_timeout_seconds": timeout_seconds})
    with open_bus(client, service="health") as session:
        session.wait_for_live({(service, instance) for instance in instances}, timeout_seconds)
        for instance in instances:
            session.query(
                session.keys.health(service, instance),
                health_pb2.HealthRequest(),
                health_pb2.Health,
                silence_seconds=timeout_seconds,
            )


def main() -> int:
    """Read the command line, check the health, and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m duralab_bus.health", description="Is a service there and answering?"
    )
    parser.add_argument("service", help="as in its liveliness key, e.g. rig_sim")
    parser.add_argument("instance", nargs="*", default=[MAIN_INSTANCE], help="rigs, of rig_sim; main of the others")
    parser.add_argument("--config", type=Path, metavar="FILE", help="the service's own; the environment counts too")
    parser.add_argument("--timeout", type=float, default=5.0, metavar="SECONDS")
    options = parser.parse_args()
    try:
        config = configured(_Joining, options.config)
        if not config.bus.connect:
            raise ConfigError(
                "The service connects to no endpoint, so its health cannot be read; name an endpoint in connect."
            )
        check_health(config.bus, options.service, options.instance, timeout_seconds=options.timeout)
    except (ConfigError, BusError, FaultError) as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_MISCONFIGURED if isinstance(error, ConfigError) else EXIT_SICK
    return 0


if __name__ == "__main__":
    sys.exit(main())
