"""A rig without mechanics, as a process of its own: what it does is asked for by the name of the run."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections import Counter
from contextlib import contextmanager

import numpy as np
import structlog

import duralab_bus
from duralab_proto.arrays import from_array, to_array
from duralab_proto.keys import rig_of
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2

RIG = "bench"
#: Reason of one of two stops that must be worked on at once.
TOGETHER = "together"


class RigProcessConfig(duralab_bus.ServiceConfig):
    rigs: tuple[str, ...] = (RIG,)


class Rig:
    def __init__(self, bus):
        self.bus = bus
        self.calls = Counter()
        self.pair = threading.Barrier(2)
        self.states = bus.publisher(bus.keys.rig_state(RIG))
        bus.serve(bus.keys.rig_play(RIG), rig_pb2.PlayRequest, self.play)
        bus.serve(bus.keys.rig_state(RIG), rig_pb2.StateRequest, self.state)
        bus.serve(bus.keys.rig_stop(RIG), rig_pb2.StopRequest, self.stop, workers=4)

    def state(self, _request, call):
        return rig_pb2.RigState(rig=rig_of(call.key), reason=str(dict(self.calls)))

    def stop(self, request, call):
        if request.reason == TOGETHER:
            # Answered only once the other one is here as well.
            self.pair.wait(120.0)
        elif request.reason:
            # As long as a ramp takes.
            time.sleep(0.6)
        return self.state(request, call)

    def play(self, request, call):
        name = request.run.partition(".")[0]
        self.calls[request.run] += 1
        return getattr(self, name)(request, call)

    def steps(self, request, call):
        for step in range(5):
            call.progress(f"step {step}", step / 5, remaining_seconds=5.0 - step, detail="going on")
        return rig_pb2.PlayResult(run=request.run, blocks=5)

    def quiet(self, request, _call):
        time.sleep(4.5)
        return rig_pb2.PlayResult(run=request.run)

    def refuse(self, _request, _call):
        raise duralab_bus.FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION, "The rig is interlocked; reset it.", field="run"
        )

    def array(self, request, _call):
        from_array(request.drive.samples, field="drive.samples")
        raise AssertionError

    def defect(self, _request, _call):
        return 1 / 0

    def nothing(self, _request, _call):
        return None

    def bulk(self, request, _call):
        samples = to_array(from_array(request.drive.samples) * 2.0)
        return rig_pb2.PlayResult(run=request.run, response=array_pb2.Record(samples=samples))

    def wait(self, request, call):
        """Go on until nobody waits any more, and say so on the state stream."""
        call.progress("waiting", 0.0)
        self.states.put(rig_pb2.RigState(rig=RIG, run=request.run, mode=rig_pb2.RIG_MODE_PLAYING))
        until = time.monotonic() + 120
        while not call.cancelled and time.monotonic() < until:
            time.sleep(0.01)
        self.states.put(rig_pb2.RigState(rig=RIG, run=request.run, mode=rig_pb2.RIG_MODE_IDLE))
        with structlog.contextvars.bound_contextvars(run=request.run):
            structlog.get_logger().info("handler ended")
        return rig_pb2.PlayResult(run=request.run)

    def stuck(self, _request, call):
        call.progress("stuck", 0.0)
        threading.Event().wait()

    def freeze(self, _request, call):
        call.progress("freezing", 0.0)
        os.kill(os.getpid(), signal.SIGSTOP)
        # The signal may take effect a moment later.
        threading.Event().wait()

    def hold(self, request, _call):
        """Native code that keeps the interpreter's lock for seconds, as a careless library may."""
        ctypes.PyDLL(None).usleep(4_000_000)
        return rig_pb2.PlayResult(run=request.run)

    def wrong(self, _request, _call):
        return rig_pb2.RigState(rig=RIG)

    def signals(self, request, _call):
        publisher = self.bus.publisher(self.bus.keys.rig_signal(RIG, request.run))
        block = to_array(np.zeros((12, 100)))
        for number in range(request.seed):
            publisher.put(rig_pb2.SignalBlock(run=request.run, first_sample=100 * number, drive=block))
        publisher.close()
        return rig_pb2.PlayResult(run=request.run, epoch=publisher.epoch, blocks=request.seed)


def build(_config):
    @contextmanager
    def build_rig(bus):
        Rig(bus)
        yield
        structlog.get_logger().info("taken apart")

    return build_rig


if __name__ == "__main__":
    duralab_bus.service_main("rig_sim", RigProcessConfig, build, instances=lambda config: config.rigs)
    sys.exit(0)
