"""`python -m iterator --config FILE`."""

from duralab_bus import HostedService, keep_few_arenas, service_main
from iterator.service import SERVICE, IteratorConfig, IteratorService

HOSTED = HostedService(SERVICE, IteratorConfig, lambda _: IteratorService)
"""The iterator as one of several services in a process."""

if __name__ == "__main__":
    # Every campaign has its own thread, which holds its records.
    keep_few_arenas(2)
    # This import takes a third of a second, which would delay the start or the first drive.
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build, needs_later=("scipy.interpolate",))
