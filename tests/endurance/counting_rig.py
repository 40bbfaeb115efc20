"""A linear rig in a process of its own that notes on disk which runs it began.

Its ledger is what no service knows of: the judge of whether a repeat was played twice.
"""

from pathlib import Path

import numpy as np

from duralab.testing import LinearRig
from duralab_bus import service_main
from duralab_gateway import SERVICE, Approach, GatewayConfig, Run, serving

RIG = "linear"
SAMPLE_RATE = 500.0
NOISE_RMS = 5.0


class CountingConfig(GatewayConfig):
    """Configuration of the rig."""

    # Each run is a line of it, written before the first sample is played.
    ledger: Path
    # Shortest time that a run takes, in seconds.
    run_seconds: float = 0.0
    # From this repeat on the first response is larger by this share, as of a specimen with a crack.
    crack_repeat: int = 1_000_000_000
    crack: float = 0.0


class CountingRig(LinearRig):
    """A linear rig with a ledger."""

    def __init__(self, config: CountingConfig) -> None:
        super().__init__(RIG, sample_rate=SAMPLE_RATE, noise_rms=NOISE_RMS)
        self._config = config
        self._noted = ""

    def play(self, commands: np.ndarray, run: Run) -> np.ndarray:
        if run.name != self._noted:
            self._noted = run.name
            with self._config.ledger.open("a") as ledger:
                ledger.write(f"{run.name}\n")
            run.wait_for_stop(self._config.run_seconds)
        response = super().play(commands, run)
        repeat = run.name.rpartition(".r")[2].partition("-")[0]
        if repeat.isdecimal() and int(repeat) >= self._config.crack_repeat:
            response[0] *= 1.0 + self._config.crack
        return response


def build(config: CountingConfig):
    """Return what serves the rig."""
    return lambda bus: serving(bus, CountingRig(config), config=config, approach=Approach(ramp=0.0))


if __name__ == "__main__":
    service_main(SERVICE, CountingConfig, build, instances=lambda _: ())
