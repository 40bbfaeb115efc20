"""`python -m recorder --config FILE`."""

from __future__ import annotations

import sys

from duralab_bus import HostedService, service_main
from recorder.config import RecorderConfig
from recorder.service import NAME, build

HOSTED = HostedService(NAME, RecorderConfig, build)
"""The recorder as one of several services in a process."""

if __name__ == "__main__":
    # Arrow, by which Rerun takes its values, imports pandas if it is installed, only to recognise its tables: half a
    # second of a processor in the thread that draws. None makes that import fail.
    sys.modules.setdefault("pandas", None)  # type: ignore[arg-type]
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
