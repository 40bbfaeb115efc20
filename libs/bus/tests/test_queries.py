"""Queries: every one ends, with its result or with a fault that says why."""

import math
import queue
import signal
import subprocess
import threading
import time
from functools import partial

import numpy as np
import pytest
import zenoh

import duralab_bus
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, health_pb2, iterator_pb2, query_pb2, rig_pb2

WAIT = 120.0


def play(bus, run, **options):
    request = rig_pb2.PlayRequest(run=run)
    return bus.query(bus.keys.rig_play("bench"), request, rig_pb2.PlayResult, **options)


def fault_of(ask):
    with pytest.raises(duralab_bus.FaultError) as caught:
        ask()
    fault = caught.value
    assert fault.message.endswith(".")
    assert "\n" not in fault.message
    return fault


def test_result_comes_back_after_its_progress_in_order(lab):
    seen = []
    result = play(lab, "steps.1", on_progress=seen.append)
    assert result == rig_pb2.PlayResult(run="steps.1", blocks=5)
    assert [progress.phase for progress in seen] == [f"step {step}" for step in range(5)]
    assert [progress.remaining_seconds for progress in seen] == [5.0, 4.0, 3.0, 2.0, 1.0]


def test_bulk_comes_back_whole(lab):
    samples = np.random.default_rng(1).standard_normal((6, 200_000))
    request = rig_pb2.PlayRequest(run="bulk.1", drive=array_pb2.Record(samples=to_array(samples)))
    result = lab.query(lab.keys.rig_play("bench"), request, rig_pb2.PlayResult)
    assert np.array_equal(from_array(result.response.samples), samples * 2.0)


def test_handler_is_called_once_per_query(lab):
    play(lab, "steps.once")
    fault_of(lambda: play(lab, "defect.once"))
    state = lab.query(lab.keys.rig_state("bench"), rig_pb2.StateRequest(), rig_pb2.RigState)
    assert "'steps.once': 1" in state.reason
    assert "'defect.once': 1" in state.reason


def test_many_at_once_are_all_answered(lab):
    results = queue.SimpleQueue()

    def ask(number):
        for index in range(10):
            results.put(play(lab, f"steps.{number}.{index}").run)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT)
    assert {results.get(timeout=WAIT) for _ in range(40)} == {f"steps.{n}.{i}" for n in range(4) for i in range(10)}


def test_handler_that_says_nothing_is_kept_alive(lab):
    seen = []
    # Longer than the silence allowed: only the server's own keep-alive lets it pass.
    assert play(lab, "quiet.1", silence_seconds=3.5, on_progress=seen.append).run == "quiet.1"
    assert len(seen) >= 2


def test_fault_of_the_service_arrives_as_it_was_raised(lab):
    fault = fault_of(lambda: play(lab, "refuse.1"))
    assert fault.code == query_pb2.FAULT_CODE_FAILED_PRECONDITION
    assert (fault.message, fault.field, fault.service) == ("The rig is interlocked; reset it.", "run", "rig_sim")


def test_damaged_array_of_the_request_is_an_invalid_argument(lab):
    request = rig_pb2.PlayRequest(run="array.1", drive=array_pb2.Record(samples=to_array(np.array([np.nan]))))
    fault = fault_of(lambda: lab.query(lab.keys.rig_play("bench"), request, rig_pb2.PlayResult))
    assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
    assert fault.field == "drive.samples"


@pytest.mark.parametrize(("run", "said"), [("defect.1", "ZeroDivisionError"), ("nothing.1", "AttributeError")])
def test_defect_of_a_handler_is_an_internal_fault(lab, run, said):
    fault = fault_of(lambda: play(lab, run))
    assert fault.code == query_pb2.FAULT_CODE_INTERNAL
    assert said in fault.message


def test_answer_of_another_type_is_not_taken(lab):
    fault = fault_of(lambda: play(lab, "wrong.1"))
    assert fault.code == query_pb2.FAULT_CODE_DATA_LOSS
    assert "duralab.v1.RigState" in fault.message
    assert "duralab.v1.PlayResult" in fault.message


def raw_query(bus, key, **options):
    """Ask as a stranger would: with Zenoh alone."""
    replies = list(bus._session.current.get(key, consolidation=zenoh.ConsolidationMode.NONE, timeout=60.0, **options))
    assert len(replies) == 1
    assert str(replies[0].err.encoding) == "application/protobuf;duralab.v1.Fault"
    return query_pb2.Fault.FromString(replies[0].err.payload.to_bytes())


@pytest.mark.parametrize(
    ("payload", "encoding", "said"),
    [
        (b"\xff\xff", "application/protobuf;duralab.v1.PlayRequest", "is not a duralab.v1.PlayRequest"),
        (b"", "application/protobuf;duralab.v1.StopRequest", "expected is 'application/protobuf;duralab.v1.PlayR"),
        (b"{}", "application/json", "expected is 'application/protobuf;duralab.v1.PlayRequest'"),
        (None, None, "expected is 'application/protobuf;duralab.v1.PlayRequest'"),
    ],
)
def test_malformed_request_is_refused_naming_what_was_expected(lab, payload, encoding, said):
    fault = raw_query(lab, lab.keys.rig_play("bench"), payload=payload, encoding=encoding)
    assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
    assert said in fault.message


def test_key_with_wildcards_moves_no_rig(lab):
    fault = raw_query(lab, lab.keys.rig_play("*"), encoding=duralab_bus.encoding_of(rig_pb2.PlayRequest))
    assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
    assert "has wildcards" in fault.message
    with pytest.raises(ValueError, match="wildcards"):
        lab.query(lab.keys.rig_play("*"), rig_pb2.PlayRequest(), rig_pb2.PlayResult)


def test_unknown_rig_and_missing_service_are_named(lab):
    fault = fault_of(lambda: lab.query(lab.keys.rig_state("other"), rig_pb2.StateRequest(), rig_pb2.RigState))
    assert fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert fault.message == "No rig 'other' is on the bus of lab 'local'; the rigs on it: 'bench'."
    health = lab.keys.health("rig_sim", "other")
    assert fault_of(lambda: lab.query(health, health_pb2.HealthRequest(), health_pb2.Health)).message == fault.message
    fault = fault_of(
        lambda: lab.query(lab.keys.campaign("c"), iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)
    )
    assert fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert "No iterator is on the bus" in fault.message
    assert "rig_sim/bench" in fault.message


def test_a_service_that_the_asker_meets_a_moment_later_is_waited_for_and_one_that_left_is_not(lab, monkeypatch):
    """What a peer is that joined last: a third one has met it already, the asker has not."""
    monkeypatch.setattr(duralab_bus.queries.client, "INTRODUCTION_SECONDS", 10 * WAIT)
    lab.discover()
    served = lab.serve(lab.keys.rig_state("late"), rig_pb2.StateRequest, lambda *_: rig_pb2.RigState(rig="late"))
    tokens = queue.SimpleQueue()
    threading.Timer(0.2, lambda: tokens.put(lab.declare_live("rig_sim", "late"))).start()
    ask = partial(lab.query, lab.keys.rig_state("late"), rig_pb2.StateRequest(), rig_pb2.RigState)
    assert ask().rig == "late"
    gone = threading.Event()
    lab._tracker.subscribe(lambda _service, name, alive: gone.set() if name == "late" and not alive else None)
    tokens.get().close()
    assert gone.wait(WAIT)
    assert fault_of(ask).code == query_pb2.FAULT_CODE_UNAVAILABLE
    served.close()


def test_key_that_a_live_service_does_not_serve_is_unimplemented(lab):
    fault = fault_of(lambda: lab.query(lab.keys.rig_reset("bench"), rig_pb2.ResetRequest(), rig_pb2.RigState))
    assert fault.code == query_pb2.FAULT_CODE_UNIMPLEMENTED


def test_cancelled_query_ends_at_once_and_the_handler_is_told(lab):
    states = queue.SimpleQueue()
    subscription = lab.subscribe(lab.keys.rig_state("bench"), rig_pb2.RigState, lambda item: states.put(item.message))
    cancel = threading.Event()
    fault = fault_of(lambda: play(lab, "wait.cancel", cancel=cancel, on_progress=lambda _: cancel.set()))
    assert fault.code == query_pb2.FAULT_CODE_CANCELLED
    assert [states.get(timeout=WAIT).mode for _ in range(2)] == [rig_pb2.RIG_MODE_PLAYING, rig_pb2.RIG_MODE_IDLE]
    subscription.close()


def test_handler_is_told_when_its_client_is_killed(lab, processes):
    states = queue.SimpleQueue()
    subscription = lab.subscribe(lab.keys.rig_state("bench"), rig_pb2.RigState, lambda item: states.put(item.message))
    client = processes.run("asking_process.py", "peer", lab.listening[0], "wait.killed")
    assert states.get(timeout=WAIT).mode == rig_pb2.RIG_MODE_PLAYING
    client.kill()
    assert states.get(timeout=WAIT).mode == rig_pb2.RIG_MODE_IDLE
    subscription.close()


def test_killed_service_ends_its_query_before_its_silence_would(hub, bench):
    killed_at = []

    def kill(_progress):
        if not killed_at:
            bench.send_signal(signal.SIGKILL)
            killed_at.append(time.monotonic())

    fault = fault_of(lambda: play(hub, "stuck.1", on_progress=kill))
    # The bus told that it is gone; its silence alone would be noticed after 10 s.
    assert time.monotonic() - killed_at[0] < 8.0
    assert fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert "left the bus" in fault.message


def test_service_told_to_end_answers_what_it_still_works_on(hub, bench):
    def end(_progress):
        bench.terminate()

    fault = fault_of(lambda: play(hub, "stuck.1", on_progress=end))
    assert fault.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert bench.wait(WAIT) == 0


def test_frozen_service_is_given_up_after_the_silence_allowed(hub, bench):
    fault = fault_of(lambda: play(hub, "freeze.1", silence_seconds=1.0))
    assert fault.code == query_pb2.FAULT_CODE_DEADLINE_EXCEEDED
    assert "silent for 1 s" in fault.message


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_a_query_ends_after_its_longest_time_though_its_service_lives_and_its_handler_learns_it(
    hub, processes, mode, until
):
    endpoint = hub.listening[0]
    if mode == "client":
        router = processes.run(
            "routing_process.py", "tcp/127.0.0.1:0", text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        endpoint = router.stdout.readline().strip()
    processes.start({"bus": {"mode": mode, "connect": [endpoint]}})
    modes, told = [], []
    with duralab_bus.open_bus(duralab_bus.BusConfig(mode=mode, connect=(endpoint,)), service="asking") as bus:
        bus.wait_for_live({("rig_sim", "bench")}, WAIT)
        bus.subscribe(bus.keys.rig_state("bench"), rig_pb2.RigState, lambda item: modes.append(item.message.mode))
        began = time.monotonic()
        fault = fault_of(lambda: play(bus, "wait.1", longest_seconds=2.5, silence_seconds=2.0, on_progress=told.append))
        assert 2.5 <= time.monotonic() - began < 10.0
        assert (fault.code, fault.field) == (query_pb2.FAULT_CODE_DEADLINE_EXCEEDED, "longest_seconds")
        assert "has not answered" in fault.message
        assert "within 2.5 s" in fault.message
        assert "see the state of the rig 'bench' before you ask again" in fault.message
        # It was alive all the time, and ends its work now that nobody waits.
        assert len(told) >= 2
        until(lambda: rig_pb2.RIG_MODE_IDLE in modes)
        assert play(bus, "steps.1", longest_seconds=60.0).blocks == 5


@pytest.mark.parametrize("seconds", [0.0, -1.0, math.nan, math.inf])
def test_a_longest_time_that_is_none_is_refused(hub, seconds):
    with pytest.raises(ValueError, match=r"longest_seconds is .*; it must be greater than 0 and at most 2592000"):
        play(hub, "steps.1", longest_seconds=seconds)


def test_busy_when_all_workers_are_taken_yet_stop_gets_through(hub, bench):
    began, cancel = threading.Event(), threading.Event()
    ask = threading.Thread(
        target=lambda: fault_of(lambda: play(hub, "wait.1", cancel=cancel, on_progress=lambda _: began.set()))
    )
    ask.start()
    assert began.wait(WAIT)
    fault = fault_of(lambda: play(hub, "steps.1"))
    assert fault.code == query_pb2.FAULT_CODE_BUSY
    assert "All 1 workers" in fault.message
    assert hub.query(hub.keys.rig_stop("bench"), rig_pb2.StopRequest(), rig_pb2.RigState).rig == "bench"
    cancel.set()
    ask.join(WAIT)
    assert not ask.is_alive()


def test_more_specific_key_answers_alone():
    calls = []

    def handler(name):
        def handle(_request, _call):
            calls.append(name)
            return iterator_pb2.CampaignStatus(id=name)

        return handle

    with duralab_bus.open_bus(service="iterator") as bus:
        bus.serve(bus.keys.recording("*"), iterator_pb2.CampaignRequest, handler("any"))
        bus.serve(bus.keys.recordings(), iterator_pb2.CampaignRequest, handler("list"))
        bus.declare_live("recorder", "main")
        with duralab_bus.open_bus(duralab_bus.BusConfig(connect=bus.listening), service="sdk") as client:
            for key, name in [(bus.keys.recordings(), "list"), (bus.keys.recording("c1"), "any")]:
                request = iterator_pb2.CampaignRequest()
                assert client.query(key, request, iterator_pb2.CampaignStatus).id == name
    assert calls == ["list", "any"]


def test_message_beyond_the_limit_is_refused_on_both_sides(hub):
    large = rig_pb2.StopRequest(reason="x" * 5000)
    with duralab_bus.open_bus(
        duralab_bus.BusConfig(connect=hub.listening, largest_payload_bytes=2000), service="rig_sim"
    ) as small:
        small.serve(small.keys.rig_stop("r"), rig_pb2.StopRequest, lambda *_: rig_pb2.RigState())
        small.declare_live("rig_sim", "r")
        for bus, service in [(hub, "rig_sim"), (small, "")]:
            key = bus.keys.rig_stop("r")
            fault = fault_of(lambda bus=bus, key=key: bus.query(key, large, rig_pb2.RigState))
            assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
            assert "5003 bytes; at most 2000" in fault.message
            assert fault.service == service


def test_a_fault_is_one_line_of_bounded_length_whatever_it_quotes(hub):
    def refuse(request, _call):
        raise duralab_bus.FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, f"The reason is {request.reason}.")

    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="rig_sim") as server:
        server.serve(server.keys.rig_stop("r"), rig_pb2.StopRequest, refuse)
        server.declare_live("rig_sim", "r")
        for reason, said in [
            ("one\n\r two", "The reason is one two."),
            ("x" * 100_000, "The reason is " + "x" * 985 + "…"),
        ]:
            with pytest.raises(duralab_bus.FaultError) as caught:
                hub.query(hub.keys.rig_stop("r"), rig_pb2.StopRequest(reason=reason), rig_pb2.RigState)
            assert caught.value.message == said


def test_a_name_that_no_key_may_hold_is_the_askers_mistake(hub):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="iterator") as server:
        server.serve(
            server.keys.campaign("*"),
            iterator_pb2.CampaignRequest,
            lambda _request, call: iterator_pb2.CampaignStatus(id=server.keys.model(call.key.rpartition("/")[2])),
        )
        server.declare_live("iterator", "main")
        key = server.keys.campaign("c")[:-1] + "Not A Name"
        fault = fault_of(lambda: hub.query(key, iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus))
        assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
        assert "'Not A Name'" in fault.message
