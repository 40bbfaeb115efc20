"""The linear rig as a service of its own process: `python rig_process.py --config FILE`."""

import threading

from linear_plants import SAMPLE_RATE, impulse_responses, play
from linear_rig import RESPONSES, STATIC, description

from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import query_pb2, rig_pb2
from labbus import FaultError, ServiceConfig, service_main


class RigConfig(ServiceConfig):
    # Name of each rig, and how long each of its playbacks lasts, in seconds.
    rigs: dict[str, float]


class LinearRig:
    def __init__(self, bus, rig, play_seconds):
        self._rig = rig
        self._play_seconds = play_seconds
        self._run = ""
        self._reason = ""
        keys = bus.keys
        bus.serve(keys.rig_description(rig), rig_pb2.DescriptionRequest, lambda *_: description(rig))
        bus.serve(keys.rig_play(rig), rig_pb2.PlayRequest, self.play)
        bus.serve(keys.rig_stop(rig), rig_pb2.StopRequest, self.stop, workers=1)
        bus.serve(keys.rig_state(rig), rig_pb2.StateRequest, lambda *_: self.state())

    def state(self):
        mode = rig_pb2.RIG_MODE_PLAYING if self._run else rig_pb2.RIG_MODE_IDLE
        if self._reason:
            mode = rig_pb2.RIG_MODE_INTERLOCKED
        return rig_pb2.RigState(rig=self._rig, mode=mode, run=self._run, reason=self._reason)

    def stop(self, request, _call):
        self._reason = request.reason
        return self.state()

    def play(self, request, call):
        self._run = request.run
        try:
            parts = round(self._play_seconds / 0.05)
            for part in range(parts):
                threading.Event().wait(0.05)
                call.progress("playing", part / parts)
                if call.cancelled or self._reason:
                    raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "The playback was broken off.")
            _, _, drive = from_record(request.drive)
            response = play(impulse_responses(), drive) + STATIC[:, None]
            return rig_pb2.PlayResult(
                run=request.run,
                response=to_record(RESPONSES, SAMPLE_RATE, response),
                actuators=[rig_pb2.ActuatorUse(drive="left", peak_command_ratio=0.5)],
                epoch=request.seed,
                blocks=drive.shape[1] // 100,
            )
        finally:
            self._run = ""


def build(config):
    def serve(bus):
        for rig, play_seconds in config.rigs.items():
            LinearRig(bus, rig, play_seconds)

    return serve


if __name__ == "__main__":
    service_main("rig_sim", RigConfig, build, instances=lambda config: tuple(config.rigs))
