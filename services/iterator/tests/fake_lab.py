"""Recorder and identifier as fakes on the bus, and a lab that asks the iterator."""

import hashlib
import time

from duralab_bus import FaultError
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2

from .linear_rig import exact_model, experiment_plan

FINAL = {
    iterator_pb2.CAMPAIGN_PHASE_FINISHED,
    iterator_pb2.CAMPAIGN_PHASE_FAULTED,
    iterator_pb2.CAMPAIGN_PHASE_STOPPED,
}


class Recorder:
    """Keeps what is committed; refuses the steps of the types it is told to."""

    def __init__(self, bus):
        self.steps = {}
        self.refused = {}
        # Called with recording, step number and whether it is stored; may raise.
        self.watch = lambda recording, step, stored: None
        # Called with a recording and whether the answer, made up already, is the last part of it.
        self.watch_reading = lambda recording, last: None
        bus.serve(bus.keys.commit(), recorder_pb2.CommitRequest, self.commit)
        bus.serve(bus.keys.recording("*"), recorder_pb2.RecordingRequest, self.recording)
        # Begin of each recording in nanoseconds since 1970; now where not said.
        self.begun = {}
        bus.serve(bus.keys.recordings(), recorder_pb2.ListRecordingsRequest, self.list)
        bus.serve(bus.keys.recording_steps("*"), recorder_pb2.ReadStepsRequest, self.read_steps)
        bus.declare_live("recorder", "main")

    def commit(self, request, _call):
        kind = request.message_type.removeprefix("duralab.v1.")
        if self.refused.get(request.recording) == kind:
            raise FaultError(query_pb2.FAULT_CODE_INTERNAL, "The disk is full.")
        self._expect_samples(kind, request.payload)
        self.watch(request.recording, request.step, False)
        steps = self.steps.setdefault(request.recording, [])
        if request.step < len(steps):
            assert steps[request.step] == (kind, request.payload)
        else:
            assert request.step == len(steps)
            assert not steps or steps[-1][0] != "RecordingClosed"
            self._expect_announced(request.recording, kind, request.payload)
            steps.append((kind, request.payload))
        self.watch(request.recording, request.step, True)
        return recorder_pb2.CommitAck(
            recording=request.recording, step=request.step, payload_hash=hashlib.sha256(request.payload).hexdigest()
        )

    @staticmethod
    def _expect_samples(kind, payload):
        """Refuse a step without samples, as a recorder that has got no signal block."""
        playback = {"IterationStep": iterator_pb2.IterationStep, "ConfirmationStep": iterator_pb2.ConfirmationStep}
        if kind in playback and not playback[kind].FromString(payload).HasField("response"):
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION, "The blocks are not here.", field="payload.samples_hash"
            )

    def _expect_announced(self, recording, kind, payload):
        planned = {run.run for run in self.read(recording, recorder_pb2.RunPlanned)}
        if kind == "RunPlayed" and (run := recorder_pb2.RunPlayed.FromString(payload).run) not in planned:
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The run {run!r} was not announced to {recording!r}."
            )

    def recording(self, _request, call):
        name = call.key.rpartition("/")[2]
        if name not in self.steps and name != "old":
            raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, f"No recording {name!r}.")
        return recorder_pb2.RecordingInfo(recording=name)

    def list(self, request, _call):
        infos = [self._information(name) for name in self.steps]
        return recorder_pb2.RecordingList(recordings=[info for info in infos if info.rig == request.rig])

    def _information(self, name):
        info = recorder_pb2.RecordingInfo(recording=name, steps=len(self.steps[name]))
        info.begun = self.begun.setdefault(name, time.time_ns())
        info.ended = self.kinds(name)[-1] == "RecordingClosed"
        for asked in (*self.read(name, iterator_pb2.CampaignSpec), *self.read(name, iterator_pb2.PreTestRequest)):
            info.rig = asked.rig
        if self.kinds(name)[0] == "PreTestRequest":
            found = self.read(name, iterator_pb2.PreTest)
            info.pre_test = found[0].verdict if found else iterator_pb2.PRE_TEST_VERDICT_UNFINISHED
        return info

    def read_steps(self, request, call):
        name = call.key.split("/")[-2]
        if name not in self.steps:
            raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, f"No recording {name!r}.")
        steps = list(enumerate(self.steps[name]))
        self.watch_reading(name, request.first + 2 >= len(steps))
        return recorder_pb2.RecordedSteps(
            # Two at a time, as a long recording comes.
            steps=[
                recorder_pb2.RecordedStep(step=number, message_type=f"duralab.v1.{kind}", payload=payload)
                for number, (kind, payload) in steps[request.first : request.first + 2]
            ],
            total=len(steps),
        )

    def kinds(self, recording):
        return [kind for kind, _ in self.steps[recording]]

    def read(self, recording, message_type):
        name = message_type.DESCRIPTOR.name
        return [message_type.FromString(payload) for kind, payload in self.steps[recording] if kind == name]


class Identifier:
    """Knows the model without an experiment."""

    def __init__(self, bus):
        self.requests = {}
        self.refused = set()
        self.unplayable = set()
        bus.serve(bus.keys.identify("*"), identifier_pb2.IdentifyRequest, self.identify)
        bus.declare_live("identifier", "main")

    def identify(self, request, call):
        if request.check_only:
            if request.run in self.unplayable:
                raise FaultError(
                    query_pb2.FAULT_CODE_INVALID_ARGUMENT, "The drive passes a limit.", field="excitation.rms"
                )
            return identifier_pb2.Model(plan=experiment_plan(request))
        self.requests[request.run] = request
        call.progress("playing", 0.5)
        if request.run in self.refused:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "The drives are dependent.")
        model = exact_model(request)
        if request.HasField("shape"):
            model.shaped_by, model.target_level = request.shape.model.run, request.shape.level
        return model


class Lab:
    def __init__(self, bus, recorder, identifier):
        self.bus, self.recorder, self.identifier = bus, recorder, identifier
        self.rigs = {}

    def start(self, spec, rig=None):
        self.rigs[spec.id] = spec.rig
        return self.bus.query(self.bus.keys.campaign_start(rig or spec.rig), spec, iterator_pb2.CampaignStatus)

    def status(self, id):
        return self.bus.query(self.bus.keys.campaign(id), iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)

    def stop(self, id, reason="enough", **options):
        return self.bus.query(
            self.bus.keys.campaign_stop(id),
            iterator_pb2.StopCampaignRequest(reason=reason),
            iterator_pb2.CampaignStatus,
            **options,
        )

    def resume(self, id, rig="", **settings):
        rig = self.rigs[settings.get("new_id", id)] = rig or self.rigs.get(id, "unknown")
        return self.bus.query(
            self.bus.keys.campaign_resume(id, rig),
            iterator_pb2.ResumeCampaignRequest(**settings),
            iterator_pb2.CampaignStatus,
        )

    def decide(self, id, proposal, kind="PLAY", *, name="Ada", reason="as foreseen", rig="", **settings):
        decision = iterator_pb2.Decision(
            proposal=proposal, kind=f"DECISION_KIND_{kind}", name=name, reason=reason, **settings
        )
        return self.bus.query(
            self.bus.keys.campaign_decide(id, rig or self.rigs.get(id, "unknown")),
            decision,
            iterator_pb2.CampaignStatus,
        )

    def held(self, id, proposal, *, seconds=20.0):
        """Wait until a campaign waits for a decision on a proposal; return the proposal as it is shown."""
        shown = self.wait(id, lambda status: status.hold.number >= proposal or status.phase in FINAL, seconds=seconds)
        assert shown.HasField("hold"), shown.activity
        return shown.hold

    def rig_state(self, rig):
        return self.bus.query(self.bus.keys.rig_state(rig), rig_pb2.StateRequest(), rig_pb2.RigState)

    def reset(self, rig):
        return self.bus.query(self.bus.keys.rig_reset(rig), rig_pb2.ResetRequest(), rig_pb2.RigState)

    def wait(self, id, done, *, seconds=20.0):
        until, status = time.monotonic() + seconds, None
        while time.monotonic() < until:
            try:
                status = self.status(id)
            except FaultError as fault:
                # On a busy machine all workers may be taken for a moment.
                if fault.code != query_pb2.FAULT_CODE_BUSY:
                    raise
            if status is not None and done(status):
                return status
            time.sleep(0.02)
        raise AssertionError(f"not reached: {status}")

    def end_of(self, id, *, seconds=20.0):
        return self.wait(id, lambda status: status.phase in FINAL, seconds=seconds)
