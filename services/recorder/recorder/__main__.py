"""`python -m recorder --config FILE`."""

from __future__ import annotations

from duralab_bus import HostedService, service_main
from recorder.config import RecorderConfig
from recorder.live import leave_out_pandas
from recorder.service import NAME, build

HOSTED = HostedService(NAME, RecorderConfig, build)
"""The recorder as one of several services in a process."""

if __name__ == "__main__":
    leave_out_pandas()
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
