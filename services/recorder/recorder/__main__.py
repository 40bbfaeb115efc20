"""`python -m recorder --config FILE`."""

from __future__ import annotations

import gc

from duralab_bus import HostedService, service_main
from recorder.config import RecorderConfig
from recorder.service import NAME, build

HOSTED = HostedService(NAME, RecorderConfig, build)
"""The service as one of several in a process."""

if __name__ == "__main__":
    # What was imported stays. Rerun's streams are only let go of by a collection, after every recording, and most of
    # its time it looked at ninety thousand objects of modules.
    gc.collect()
    gc.freeze()
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
