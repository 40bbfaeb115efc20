"""What ends a campaign, or does not, in a lab within this process: its rig can be asked but does not play."""

import re
import threading
import time
from contextlib import contextmanager

from duralab_bus import BusConfig, RecordingLog, SpoolFullError, open_bus
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from iterator.service import IteratorService

from .fake_lab import Lab, Recorder
from .linear_rig import description, exact_model, experiment_plan, specification


def checked_or(identify, recorder):
    def answer(request, call):
        if request.check_only:
            return identifier_pb2.Model(plan=experiment_plan(request))
        return identify(recorder, request, call)

    return answer


@contextmanager
def lab_in_this_process(name, identify):
    """A lab without processes, whose rig can be asked but does not play."""
    with open_bus(BusConfig(lab=name), service="test") as hub:
        joined = BusConfig(lab=name, connect=hub.listening)
        with (
            open_bus(joined, service="rig_sim") as rig,
            open_bus(joined, service="identifier") as identifier,
            open_bus(joined, service="recorder") as recorder,
            open_bus(joined, service="iterator") as iterator,
        ):
            keys = hub.keys
            rig.serve(keys.rig_description("front"), rig_pb2.DescriptionRequest, lambda *_: description())
            state = rig_pb2.RigState(mode=rig_pb2.RIG_MODE_IDLE)

            def stop(request, _call):
                state.mode, state.reason = rig_pb2.RIG_MODE_INTERLOCKED, request.reason
                return state

            rig.serve(keys.rig_state("front"), rig_pb2.StateRequest, lambda *_: state)
            rig.serve(keys.rig_stop("front"), rig_pb2.StopRequest, stop, workers=1)
            rig.declare_live("rig_sim", "front")
            identifier.serve(keys.identify("*"), identifier_pb2.IdentifyRequest, checked_or(identify, recorder))
            identifier.declare_live("identifier", "main")
            lab = Lab(hub, Recorder(recorder), None)
            with IteratorService(iterator) as service:
                iterator.declare_live("iterator", "main")
                yield lab, service


def test_a_recorder_that_vanishes_ends_the_campaign():
    def identify(recorder, request, _call):
        recorder.close()
        return exact_model(request)

    with lab_in_this_process("iterator_vanishing", identify) as (lab, _):
        lab.start(specification("lost"))
        status = lab.end_of("lost", seconds=10.0)
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_FAULTED
    assert status.fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert re.search(r"while storing the model: (No recorder is on|The recorder left) the bus", status.fault.message)


def test_a_stop_between_two_steps_is_told_with_the_one_before(monkeypatch):
    commit = RecordingLog.commit

    def stopping(log, message):
        commit(log, message)
        if isinstance(message, recorder_pb2.RunPlayed):
            service._campaigns.get("between").work.stop("enough")

    monkeypatch.setattr(RecordingLog, "commit", stopping)
    with lab_in_this_process("iterator_between", lambda _recorder, request, _call: exact_model(request)) as found:
        lab, service = found
        lab.start(specification("between"))
        status = lab.end_of("between", seconds=10.0)
    assert status.activity == "stopped while storing the model"
    assert status.fault.message == "The campaign was stopped while storing the model: enough."


def test_the_warnings_of_the_identification_are_remarks_of_the_campaign():
    def doubted_model(request):
        model = exact_model(request)
        model.warnings.add(channel="force", sentence="The static gain of force has not settled.")
        return model

    with lab_in_this_process("iterator_doubted", lambda _recorder, request, _call: doubted_model(request)) as found:
        lab, _ = found
        lab.start(specification("doubted"))
        status = lab.end_of("doubted")
    assert "Identification: The static gain of force has not settled." in status.remarks


def test_an_event_that_cannot_be_kept_ends_no_campaign(monkeypatch):
    class FullPublisher:
        closed = False

        def put(self, _event):
            raise SpoolFullError("the spool is full.")

        def close(self):
            self.closed = True

    full = FullPublisher()
    with open_bus(BusConfig(lab="iterator_full"), service="iterator") as bus, IteratorService(bus) as service:
        monkeypatch.setattr(bus, "publisher", lambda _key: full)
        publish = service._publishing("night")
        publish(iterator_pb2.CampaignStatus(id="night", phase=iterator_pb2.CAMPAIGN_PHASE_ITERATING))
        assert not full.closed
        publish(iterator_pb2.CampaignStatus(id="night", phase=iterator_pb2.CAMPAIGN_PHASE_FAULTED))
        assert full.closed


def test_the_end_of_the_service_stops_its_campaigns():
    identifying = threading.Event()

    def identify(_recorder, request, call):
        identifying.set()
        while not call.cancelled:
            time.sleep(0.02)
        return exact_model(request)

    with lab_in_this_process("iterator_ending", identify) as (lab, service):
        lab.start(specification("cut"))
        assert identifying.wait(5.0)
        service.__exit__(None, None, None)
        status = lab.status("cut")
        # Nothing was broken off on the rig: nobody has to look at it before the campaign is resumed.
        assert lab.rig_state("front").mode == rig_pb2.RIG_MODE_IDLE
    assert status.phase == iterator_pb2.CAMPAIGN_PHASE_STOPPED
    assert status.fault.message.endswith("stopped while identifying front: the iterator was told to end.")
    assert lab.recorder.kinds("cut")[-1] == "RecordingClosed"
