"""Tokens of askers: used again while all is well, gone for ever with a query that was given up."""

import queue
import signal
import subprocess
import threading

import pytest
import zenoh

import duralab_bus
from duralab_proto.v1 import query_pb2, rig_pb2

WAIT = 120.0
PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}


@pytest.fixture
def asker(hub):
    with duralab_bus.open_bus(duralab_bus.BusConfig(connect=hub.listening), service="asker") as bus:
        bus.discover()
        yield bus


@pytest.fixture
def tokens(hub):
    """Ids of askers' tokens as they come and, with a '-' before them, go."""
    seen = queue.SimpleQueue()

    def note(sample):
        asker = str(sample.key_expr).rpartition("/")[2]
        seen.put(asker if sample.kind == zenoh.SampleKind.PUT else f"-{asker}")

    liveliness = hub._session.current.liveliness()
    subscriber = liveliness.declare_subscriber(hub.keys.asking("*"), zenoh.handlers.Callback(note, indirect=False))
    yield seen
    subscriber.undeclare()


def serve(hub, handle):
    hub.serve(hub.keys.rig_stop("r"), rig_pb2.StopRequest, handle, workers=2)
    hub.declare_live("rig_sim", "r")


def ask(asker, **options):
    return asker.query(asker.keys.rig_stop("r"), rig_pb2.StopRequest(), rig_pb2.RigState, **options)


def test_queries_one_after_the_other_have_one_token_whatever_is_answered(hub, asker, tokens):
    def handle(*_):
        if len(answers) % 2:
            raise duralab_bus.FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, "It is latched.")
        return rig_pb2.RigState()

    answers = []
    serve(hub, handle)
    asker.wait_for_live({("rig_sim", "r")}, WAIT)
    for _ in range(20):
        try:
            answers.append(ask(asker))
        except duralab_bus.FaultError as fault:
            answers.append(fault.code)
    first = tokens.get(timeout=WAIT)
    asker.close()
    assert tokens.get(timeout=WAIT) == f"-{first}"
    assert answers.count(query_pb2.FAULT_CODE_FAILED_PRECONDITION) == 10


def test_queries_at_once_have_a_token_each(hub, asker, tokens):
    together = threading.Barrier(2)

    def handle(*_):
        together.wait(WAIT)
        return rig_pb2.RigState()

    serve(hub, handle)
    asker.wait_for_live({("rig_sim", "r")}, WAIT)
    for _ in range(3):
        asking = [threading.Thread(target=ask, args=(asker,)) for _ in range(2)]
        for thread in asking:
            thread.start()
        for thread in asking:
            thread.join(WAIT)
    seen = {tokens.get(timeout=WAIT) for _ in range(2)}
    asker.close()
    assert {tokens.get(timeout=WAIT) for _ in range(2)} == {f"-{asker}" for asker in seen}


def test_token_of_a_query_that_is_given_up_goes_and_its_handler_alone_is_told(hub, asker, tokens):
    running, told = threading.Event(), threading.Event()

    def handle(request, call):
        if request.reason == "next":
            # Longer than it takes until a departure counts: the one before must not be taken for this one.
            return rig_pb2.RigState(reason=str(call._cancelled.wait(1.0)))
        running.set()
        if call._cancelled.wait(WAIT):
            told.set()
        return rig_pb2.RigState()

    serve(hub, handle)
    asker.wait_for_live({("rig_sim", "r")}, WAIT)
    fault = []

    def given_up():
        with pytest.raises(duralab_bus.FaultError) as caught:
            ask(asker, cancel=running)
        fault.append(caught.value.code)

    thread = threading.Thread(target=given_up)
    thread.start()
    thread.join(WAIT)
    assert fault == [query_pb2.FAULT_CODE_CANCELLED]
    request = rig_pb2.StopRequest(reason="next")
    assert asker.query(asker.keys.rig_stop("r"), request, rig_pb2.RigState).reason == "False"
    assert told.wait(WAIT)
    first, gone, second = (tokens.get(timeout=WAIT) for _ in range(3))
    assert gone == f"-{first}"
    assert second != first


@pytest.fixture(params=["peer", "client"])
def config(request, hub, processes):
    """How to join a lab of peers, and one with a router."""
    if request.param == "peer":
        return duralab_bus.BusConfig(connect=(hub.listening[0],))
    router = processes.run("routing_process.py", "tcp/127.0.0.1:0", text=True, **PIPES)
    return duralab_bus.BusConfig(mode="client", connect=(router.stdout.readline().strip(),))


def tell(process):
    process.stdin.write(b"\n")
    process.stdin.flush()


def test_service_that_came_after_the_token_is_told_when_the_asker_is_killed(config, processes, until):
    service = {"bus": {"mode": config.mode.value, "connect": list(config.connect)}}
    states = queue.SimpleQueue()
    with duralab_bus.open_bus(config, service="watching") as bus:
        bus.subscribe(bus.keys.rig_state("bench"), rig_pb2.RigState, lambda item: states.put(item.message.mode))
        first = processes.start(service)
        bus.wait_for_live({("rig_sim", "bench")}, WAIT)
        asker = processes.run(
            "asking_process.py", config.mode.value, *config.connect, "steps.1", "wait.killed", **PIPES
        )
        assert asker.stdout.readline() == b"answered\n"
        first.terminate()
        assert first.wait(WAIT) == 0
        until(lambda: not bus.live("rig_sim"))
        processes.start(service)
        bus.wait_for_live({("rig_sim", "bench")}, WAIT)
        tell(asker)
        assert states.get(timeout=WAIT) == rig_pb2.RIG_MODE_PLAYING
        asker.kill()
        assert states.get(timeout=10.0) == rig_pb2.RIG_MODE_IDLE


def test_asker_that_was_frozen_until_its_token_was_gone_is_answered_again(config, processes, until):
    processes.start({"bus": {"mode": config.mode.value, "connect": list(config.connect)}})
    with duralab_bus.open_bus(config, service="watching") as bus:
        bus.wait_for_live({("rig_sim", "bench")}, WAIT)
        runs = ["steps.1", "steps.2", "steps.3"]
        asker = processes.run("asking_process.py", config.mode.value, *config.connect, *runs, **PIPES)
        seen = set()

        def note(sample):
            (seen.add if sample.kind == zenoh.SampleKind.PUT else seen.discard)(str(sample.key_expr))

        token = bus._session.current.liveliness().declare_subscriber(
            bus.keys.asking("*"), zenoh.handlers.Callback(note, indirect=False), history=True
        )
        for _ in runs[1:]:
            assert asker.stdout.readline() == b"answered\n"
            # The rig may meet the asker, and answer, before whoever watches does.
            until(lambda: seen)
            asker.send_signal(signal.SIGSTOP)
            until(lambda: not seen)
            asker.send_signal(signal.SIGCONT)
            tell(asker)
        assert asker.wait(WAIT) == 0
        token.undeclare()
