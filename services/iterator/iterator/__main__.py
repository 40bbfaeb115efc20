"""`python -m iterator --config FILE`."""

from iterator.service import SERVICE, IteratorConfig, IteratorService
from labbus import HostedService, service_main

HOSTED = HostedService(SERVICE, IteratorConfig, lambda _: IteratorService)
"""The service as one of several in a process."""

if __name__ == "__main__":
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
