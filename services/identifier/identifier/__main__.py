"""Run the identifier: `python -m identifier --config FILE`."""

from collections.abc import Callable

from identifier.service import SERVICE, IdentifierConfig, IdentifierService
from labbus import Bus, service_main


def _build(config: IdentifierConfig) -> Callable[[Bus], None]:
    def build(bus: Bus) -> None:
        IdentifierService(bus, config)

    return build


if __name__ == "__main__":
    service_main(SERVICE, IdentifierConfig, _build)
