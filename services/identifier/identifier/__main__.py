"""Run the identifier: `python -m identifier --config FILE`."""

from collections.abc import Callable

from duralab_bus import Bus, HostedService, service_main
from identifier.service import SERVICE, IdentifierConfig, IdentifierService


def _build(config: IdentifierConfig) -> Callable[[Bus], None]:
    def build(bus: Bus) -> None:
        IdentifierService(bus, config)

    return build


HOSTED = HostedService(SERVICE, IdentifierConfig, _build)
"""The identifier as one of several services in a process."""

if __name__ == "__main__":
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build, needs_later=("scipy.interpolate",))
