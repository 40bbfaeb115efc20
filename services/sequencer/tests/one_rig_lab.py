"""A bus with one rig, a recorder and an iterator, all in this process, for an endurance test on its own thread."""

import hashlib
import time

import numpy as np

from duralab_bus import Call, FaultError
from duralab_proto.arrays import to_array, to_record
from duralab_proto.keys import Keys
from duralab_proto.v1 import array_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2, sequencer_pb2
from sequencer.endurance.endurance_test import EnduranceTest, Progress
from sequencer.endurance.messages import column_names
from sequencer.endurance.plan import plan_endurance
from sequencer.endurance.recorded import RecordedTest, RecordedVolume
from sequencer.endurance.resumption import recorded_progress
from sequencer.endurance.status_board import EnduranceBoard

RIG, RATE, SAMPLES = "bench", 100.0, 400
TIME = np.arange(SAMPLES) / RATE
DRIVE = 0.01 * np.sin(2.0 * np.pi * 5.0 * TIME)[np.newaxis]
RESPONSES = ("force", "body")
DESCRIPTION = rig_pb2.RigDescription(
    rig=RIG,
    sample_rate=RATE,
    simulated=True,
    longest_drive_seconds=100.0,
    drives=[array_pb2.Channel(name="stroke", unit="m", minimum=-0.1, maximum=0.1, slew_limit=1.0)],
    responses=[array_pb2.Channel(name=name, unit="N") for name in RESPONSES],
)

KINDS = {
    kind.DESCRIPTOR.name: kind
    for kind in (
        *(sequencer_pb2.EnduranceSpec, sequencer_pb2.EnduranceVolume, sequencer_pb2.EnduranceRepeat),
        *(sequencer_pb2.EnduranceDrive, sequencer_pb2.EnduranceHold, sequencer_pb2.EnduranceDecision),
        *(sequencer_pb2.CorrectionPlanned, sequencer_pb2.EnduranceCorrection, sequencer_pb2.EnduranceStatus),
        *(sequencer_pb2.RepeatSamples, rig_pb2.RigDescription),
        *(recorder_pb2.RunPlanned, recorder_pb2.RunPlayed, recorder_pb2.RecordingClosed),
    )
}


def campaign(*, weights=None, lowest_frequency=1.0):
    """Return the campaign of an event's drive."""
    zeros = to_record(DESCRIPTION.responses, RATE, np.zeros((len(RESPONSES), SAMPLES)))
    spec = iterator_pb2.CampaignSpec(rig=RIG, target=zeros, lowest_frequency=lowest_frequency, highest_frequency=25.0)
    if weights is not None:
        spec.update.weights.CopyFrom(to_array(np.asarray(weights, dtype=float)))
    return spec


class OneRigLab:
    """`change`: Returns the response of a repeat from the undisturbed one. `made_by`: Campaign of the first event."""

    service = "test"

    def __init__(self, *, change=lambda _repeat, response: response, made_by=None):
        self.keys = Keys()
        self.played, self.campaigns, self.steps = [], [], []
        self.interrupt_from = 1_000_000
        self._change, self._made_by = change, made_by
        self.recordings = {} if made_by is None else {"made": [made_by]}
        #: Status of a campaign that runs, by its id.
        self.running = {}

    def query(self, key, request, answer, **others):
        match request:
            case rig_pb2.StateRequest():
                return answer(mode=rig_pb2.RIG_MODE_IDLE)
            case rig_pb2.DescriptionRequest():
                return DESCRIPTION
            case rig_pb2.PlayRequest():
                return self._play(request, answer, others["cancel"])
            case recorder_pb2.CommitRequest():
                self.steps.append((request.message_type.rpartition(".")[2], request.payload))
                return answer(step=request.step, payload_hash=hashlib.sha256(request.payload).hexdigest())
            case recorder_pb2.ReadStepsRequest():
                return self._recorded(key, request, answer)
            case iterator_pb2.CampaignRequest():
                for id, status in self.running.items():
                    if key == self.keys.campaign(id):
                        return status
                raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, "There is no such campaign.")
            case iterator_pb2.StopCampaignRequest():
                (id,) = [id for id in self.running if key == self.keys.campaign_stop(id)]
                self.running[id].phase = iterator_pb2.CAMPAIGN_PHASE_STOPPED
                return self.running[id]
            case rig_pb2.StopRequest():
                return answer(mode=rig_pb2.RIG_MODE_INTERLOCKED)
        raise AssertionError(f"{key} of {type(request).__name__} is not expected.")

    def _recorded(self, key, request, answer):
        for id, messages in self.recordings.items():
            if key == self.keys.recording_steps(id):
                steps = [
                    recorder_pb2.RecordedStep(
                        step=number, message_type=each.DESCRIPTOR.full_name, payload=each.SerializeToString()
                    )
                    for number, each in enumerate(messages)
                ]
                return answer(steps=steps[request.first :], total=len(steps))
        raise FaultError(query_pb2.FAULT_CODE_NOT_FOUND, "There is no such recording.")

    def live(self, *_):
        return False

    def _play(self, request, answer, cancel):
        repeat = int(request.run.rpartition(".r")[2].partition("-")[0])
        self.played.append(repeat)
        if repeat >= self.interrupt_from:
            assert cancel.wait(10.0)
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "The query was cancelled.")
        noise = np.random.default_rng(repeat).normal(0.0, 0.2, (len(RESPONSES), SAMPLES))
        response = self._change(repeat, 1000.0 * np.vstack([DRIVE, DRIVE]) + noise)
        return answer(run=request.run, response=to_record(DESCRIPTION.responses, RATE, response))

    def test(self, *, repeats, more="", events=1, recorded=None):
        """Return a started endurance test and its board; it continues after the messages of a recording, if given."""
        names = [f"road_{number}" for number in range(events)]
        schedule = (
            f"name: weeks\nrig: {RIG}\norder: in_order\nevents:\n"
            + "".join(f"  {name}: {{drive: {name}.csv, repeats: {repeats}}}\n" for name in names)
            + more
        )
        spec = sequencer_pb2.EnduranceSpec(id="weeks", rig=RIG, schedule=schedule)
        for name in names:
            record = to_record(DESCRIPTION.drives, RATE, DRIVE)
            spec.events.add(name=name, drive=record, campaign="made" if self._made_by is not None else "")
        plan = plan_endurance(spec, DESCRIPTION)
        status = sequencer_pb2.EnduranceStatus(
            id="weeks", rig=RIG, repeats=len(plan.sequence), columns=column_names(plan.schedule.monitoring)
        )
        board = EnduranceBoard(status, publish=lambda _: None)
        before = Progress(tallies=plan.fresh_tallies(), monitor=plan.fresh_monitor())
        if recorded is not None:
            volume = RecordedVolume(number=1)
            for message in recorded:
                volume.take(message)
            before = recorded_progress(RecordedTest(spec, volume), plan)
        test = EnduranceTest(
            plan,
            before,
            bus=self,
            board=board,
            repeats_per_volume=1000,
            held_files=None,
            on_end=lambda: None,
        )
        test.start()
        return test, board


def messages(lab):
    """Return what a test recorded."""
    return [KINDS[kind].FromString(payload) for kind, payload in lab.steps]


def wait_for(board, fits, seconds=20.0):
    """Return the first status that fits."""
    until = time.monotonic() + seconds
    while not fits(status := board.snapshot()):
        assert time.monotonic() < until, status
        time.sleep(0.01)
    return status


def holding_or_ended(status):
    return status.phase == sequencer_pb2.ENDURANCE_PHASE_HOLDING or status.phase in (
        sequencer_pb2.ENDURANCE_PHASE_FINISHED,
        sequencer_pb2.ENDURANCE_PHASE_FAULTED,
        sequencer_pb2.ENDURANCE_PHASE_STOPPED,
    )


def decide(test, status, kind):
    """Bring a decision on the open hold."""
    decision = sequencer_pb2.EnduranceDecision(hold=status.hold.number, kind=kind, name="Ada", reason="a reason")
    test.decide(decision, call())


def call():
    return Call("a/key", send=lambda _: None, cancelled=None)
