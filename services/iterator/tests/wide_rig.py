"""A linear, noisy rig of two drives and three responses on the bus, in the test's own process."""

from contextlib import contextmanager

import numpy as np

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_proto.arrays import from_record, to_array, to_record
from duralab_proto.v1 import array_pb2, iterator_pb2, query_pb2, rig_pb2
from iterator.service import IteratorService

from . import linear_rig
from .fake_lab import Lab, Recorder
from .linear_plants import SAMPLE_RATE, frequency_response, impulse_responses, noise_target, play

RESPONSES = [*linear_rig.RESPONSES, array_pb2.Channel(name="beam", unit="N", minimum=-1e5, maximum=1e5)]


def impulses():
    h = impulse_responses()
    return np.concatenate([h, 0.4 * h[:1, :, :] + 20.0 * h[1:, ::-1, :]])


def description():
    told = linear_rig.description()
    del told.responses[:]
    told.responses.extend(RESPONSES)
    told.static_response.CopyFrom(to_array(np.array([3600.0, 20.0, 5.0])))
    return told


def model(request):
    made = linear_rig.exact_model(request)
    frequency, frf = frequency_response(impulses(), request.estimator.block_samples)
    frf[(frequency < 1.0) | (frequency > 70.0)] = 0.0
    made.frf.CopyFrom(to_array(frf))
    del made.responses[:]
    made.responses.extend(RESPONSES)
    made.coherence.CopyFrom(to_array(np.ones(frf.shape[:2])))
    return made


def specification(id, *, target=None, weight=(1.0, 1.0, 0.0), **settings):
    spec = linear_rig.specification(id, gain=(0.5, 0.5, 0.5), **settings)
    if target is None:
        target = np.vstack([noise_target(8000), np.zeros(8000)])
    spec.target.CopyFrom(to_record(RESPONSES, SAMPLE_RATE, target))
    if weight is not None:
        spec.update.weights.CopyFrom(to_array(np.array(weight)))
    return spec


class WideRig:
    """Comes, plays, fails at one run, leaves at one run or has a stuck sensor in some, as it is told."""

    def __init__(self, config):
        self._config = config
        self.noise = 0.0
        self.failing = ""
        self.leaving = ""
        # Number of a response and the runs in which it is stuck.
        self.stuck = (0, ())
        self.seeds = []
        # Whether each playback was asked for in real time.
        self.paced = []
        self.come()

    def come(self):
        self._bus = open_bus(self._config, service="rig_sim")
        keys = self._bus.keys
        idle = rig_pb2.RigState(mode=rig_pb2.RIG_MODE_IDLE)
        self._bus.serve(keys.rig_description("front"), rig_pb2.DescriptionRequest, lambda *_: description())
        self._bus.serve(keys.rig_state("front"), rig_pb2.StateRequest, lambda *_: idle)
        self._bus.serve(keys.rig_play("front"), rig_pb2.PlayRequest, self.play)
        self._bus.declare_live("rig_sim", "front")

    def leave(self):
        self._bus.close()

    def play(self, request, _call):
        if request.run == self.failing:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "The left piston is at its end stop.")
        if request.run == self.leaving:
            self.leave()
        self.seeds.append(request.seed)
        self.paced.append(request.real_time)
        _, _, drive = from_record(request.drive)
        response = play(impulses(), drive) + 500.0
        response += self.noise * np.random.default_rng(request.seed).standard_normal(response.shape)
        channel, runs = self.stuck
        if request.run in runs:
            response[channel, 3000:] = response[channel, 3000]
        return rig_pb2.PlayResult(
            run=request.run, response=to_record(RESPONSES, SAMPLE_RATE, response), epoch=request.seed, blocks=80
        )


class Identifier:
    def __init__(self, bus):
        self.answer = model
        bus.serve(bus.keys.identify("*"), linear_rig.identifier_pb2.IdentifyRequest, self.identify)
        bus.declare_live("identifier", "main")

    def identify(self, request, _call):
        if request.check_only:
            return linear_rig.identifier_pb2.Model(plan=linear_rig.experiment_plan(request))
        self.paced = request.real_time
        return self.answer(request)


@contextmanager
def wide_lab(name):
    with open_bus(BusConfig(lab=name), service="test") as hub:
        joined = BusConfig(lab=name, connect=hub.listening)
        with (
            open_bus(joined, service="identifier") as identifier,
            open_bus(joined, service="recorder") as recorder,
            open_bus(joined, service="iterator") as iterator,
        ):
            lab = Lab(hub, Recorder(recorder), Identifier(identifier))
            lab.rig = WideRig(joined)
            with IteratorService(iterator):
                iterator.declare_live("iterator", "main")
                hub.wait_for_live({("rig_sim", "front"), ("iterator", "main"), ("recorder", "main")}, 60.0)
                yield lab
            lab.rig.leave()


def drives_of(lab, id):
    return [step.drive.samples.data for step in lab.recorder.read(id, iterator_pb2.IterationStep)]
