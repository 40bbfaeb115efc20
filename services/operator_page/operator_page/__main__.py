"""`python -m operator_page --config FILE`: serve the page until it is asked to end."""

from duralab_bus import HostedService, service_main
from operator_page.config import PageConfig
from operator_page.service import NAME, build

HOSTED = HostedService(NAME, PageConfig, build)
"""The operator page as one of several services in a process."""

if __name__ == "__main__":
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
