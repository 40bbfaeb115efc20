"""`python -m iterator --config FILE`."""

from iterator.service import SERVICE, IteratorConfig, IteratorService
from labbus import service_main

if __name__ == "__main__":
    service_main(SERVICE, IteratorConfig, lambda _: IteratorService)
