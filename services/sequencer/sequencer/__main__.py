"""`python -m sequencer --config FILE`."""

from duralab_bus import HostedService, keep_few_arenas, service_main
from sequencer.service import SERVICE, SequencerConfig, build

HOSTED = HostedService(SERVICE, SequencerConfig, build)
"""The service as one of several in a process."""

if __name__ == "__main__":
    # Every test has its own thread, and holds its responses there.
    keep_few_arenas(2)
    # Half a second and more of imports, which the first damage would wait for.
    service_main(
        HOSTED.name,
        HOSTED.config_type,
        HOSTED.build,
        needs_later=("pylife.stress.rainflow", "scipy.signal"),
    )
