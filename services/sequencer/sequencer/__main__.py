"""`python -m sequencer --config FILE`."""

from duralab_bus import HostedService, keep_few_arenas, service_main
from sequencer.service import SERVICE, SequencerConfig, build

HOSTED = HostedService(SERVICE, SequencerConfig, build)
"""The sequencer as one of several services in a process."""

if __name__ == "__main__":
    # Every test has its own thread, which holds its responses.
    keep_few_arenas(2)
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build)
