"""The linear rig as a service of its own process: `python rig_process.py --config FILE`."""

from duralab.testing import LinearRig
from duralab_bus import service_main
from duralab_gateway import SERVICE, Approach, GatewayConfig, serving
from duralab_proto.v1 import array_pb2

if __package__:
    from .linear_plants import SAMPLE_RATE, impulse_responses
    from .linear_rig import DRIVES, RESPONSES, STATIC
else:
    from linear_plants import SAMPLE_RATE, impulse_responses
    from linear_rig import DRIVES, RESPONSES, STATIC


class RigConfig(GatewayConfig):
    # Name of each rig, and how long each of its playbacks lasts, in seconds.
    rigs: dict[str, float]
    # Of these, the ones whose runs go on to their end.
    cannot_be_stopped: tuple[str, ...] = ()
    # In N: next to nothing, and other numbers for each seed.
    noise_rms: float = 0.0


# Of the rig "worn": every playback of a campaign crosses its warning level.
WORN_SENSOR = array_pb2.Sensor(serial_number="LC-1", calibration_due="2020-02-29", warning_level=4500.0)

# What a rig says in the first half of a playback.
WAITING = "waiting for the operator\x1b[2J to press start"


def known_rig(name="front", noise_rms=0.0):
    return SlowRig(name, 0.0, goes_on=False, noise_rms=noise_rms)


class SlowRig(LinearRig):
    """Takes a whole drive, and the time that it is told."""

    def __init__(self, name, play_seconds, *, goes_on, noise_rms):
        plant = [[(h, [1.0]) for h in row] for row in impulse_responses()]
        channels = {"drives": DRIVES, "responses": RESPONSES, "sample_rate": SAMPLE_RATE}
        super().__init__(name, plant=plant, static=STATIC, noise_rms=noise_rms, **channels)
        self._parts, self._goes_on = round(play_seconds / 0.05), goes_on

    def describe(self):
        told = super().describe()
        told.content_hash, told.publishes_after_run, told.cannot_be_stopped = "linear", True, self._goes_on
        if self.name == "worn":
            told.responses[0].sensor.CopyFrom(WORN_SENSOR)
        if self.name == "inverted":
            # By its table; what it measures is positive.
            told.responses[1].sensor.polarity = array_pb2.POLARITY_NEGATIVE
        return told

    def play(self, commands, run):
        for part in range(self._parts):
            waits = part < self._parts / 2
            run.report(WAITING if waits else "playing", 0.0 if waits else part / self._parts)
            if run.wait_for_stop(0.05):
                return super().play(commands[:, : commands.shape[1] * part // self._parts], run)
        return super().play(commands, run)


def build(config):
    goes_on, noise = config.cannot_be_stopped, config.noise_rms
    rigs = [SlowRig(name, time, goes_on=name in goes_on, noise_rms=noise) for name, time in config.rigs.items()]
    return lambda bus: serving(bus, *rigs, config=config, approach=Approach(ramp=0.0))


if __name__ == "__main__":
    service_main(SERVICE, RigConfig, build, instances=lambda _: ())
