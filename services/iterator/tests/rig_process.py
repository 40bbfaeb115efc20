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
    # Of these, the ones whose runs go on to their end.
    cannot_be_stopped: tuple[str, ...] = ()


# What a rig says in the first half of a playback.
WAITING = "waiting for the operator\x1b[2J to press start"


class LinearRig:
    def __init__(self, bus, rig, play_seconds, *, goes_on):
        self._rig = rig
        self._play_seconds = play_seconds
        self._goes_on = goes_on
        self._run = ""
        self._reason = ""
        self._changed = threading.Condition()
        keys = bus.keys
        bus.serve(keys.rig_description(rig), rig_pb2.DescriptionRequest, lambda *_: description(rig))
        bus.serve(keys.rig_play(rig), rig_pb2.PlayRequest, self.play)
        bus.serve(keys.rig_stop(rig), rig_pb2.StopRequest, self.stop, workers=1)
        bus.serve(keys.rig_reset(rig), rig_pb2.ResetRequest, self.reset, workers=1)
        bus.serve(keys.rig_state(rig), rig_pb2.StateRequest, lambda *_: self.state())

    def state(self):
        mode = rig_pb2.RIG_MODE_PLAYING if self._run else rig_pb2.RIG_MODE_IDLE
        if self._reason:
            mode = rig_pb2.RIG_MODE_INTERLOCKED
        return rig_pb2.RigState(rig=self._rig, mode=mode, run=self._run, reason=self._reason)

    def stop(self, request, _call):
        with self._changed:
            self._reason = self._reason or request.reason
            if not self._goes_on:
                assert self._changed.wait_for(lambda: not self._run, 10.0)
            return self.state()

    def reset(self, _request, _call):
        with self._changed:
            assert self._changed.wait_for(lambda: not self._run, 10.0)
            self._reason = ""
            return self.state()

    def play(self, request, call):
        with self._changed:
            if self._reason:
                raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"It is interlocked ({self._reason}).")
            self._run = request.run
        try:
            parts = round(self._play_seconds / 0.05)
            for part in range(parts):
                threading.Event().wait(0.05)
                if part < parts / 2:
                    call.progress(WAITING, 0.0, detail=f"run {request.run}")
                else:
                    call.progress("playing", part / parts, detail=request.run)
                if (call.cancelled or self._reason) and not self._goes_on:
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
            with self._changed:
                self._run = ""
                self._changed.notify_all()


def build(config):
    def serve(bus):
        for rig, play_seconds in config.rigs.items():
            LinearRig(bus, rig, play_seconds, goes_on=rig in config.cannot_be_stopped)

    return serve


if __name__ == "__main__":
    service_main("rig_sim", RigConfig, build, instances=lambda config: tuple(config.rigs))
