"""`python -m recorder --config FILE`."""

from __future__ import annotations

from labbus import service_main
from recorder.config import RecorderConfig
from recorder.service import NAME, build

if __name__ == "__main__":
    service_main(NAME, RecorderConfig, build)
