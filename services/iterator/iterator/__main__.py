"""`python -m iterator --config FILE`."""

from duralab_bus import HostedService, keep_few_arenas, service_main
from iterator.service import SERVICE, IteratorConfig, IteratorService

HOSTED = HostedService(SERVICE, IteratorConfig, lambda _: IteratorService)
"""The service as one of several in a process."""

if __name__ == "__main__":
    # Every campaign has its own thread, and holds its records there.
    keep_few_arenas(2)
    # Half a second and more of imports, which the first damage would wait for.
    service_main(
        HOSTED.name,
        HOSTED.config_type,
        HOSTED.build,
        needs_later=("pylife.stress.rainflow", "scipy.interpolate", "scipy.signal"),
    )
