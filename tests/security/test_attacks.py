"""A real rig behind a secured router: what is replayed, malformed, too large or without end is refused and told of."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import zenoh

from duralab.security.router_log import Refusal
from duralab_bus import Bus, FaultError, encoding_of
from duralab_proto.access import SMALL_QUERY_BYTES
from duralab_proto.arrays import to_record
from duralab_proto.v1 import query_pb2, rig_pb2

from .access_trials import secured_config
from .members import RIG
from .secured_lab import running, secured_bus
from .secured_router import ROOT, SecuredRouter

LARGEST = 4 * 1024 * 1024
SECONDS = 10.0
PLAY = encoding_of(rig_pb2.PlayRequest)


@dataclass
class SecuredRig:
    operator: Bus
    router: SecuredRouter
    certificates: Path
    log: Path
    description: rig_pb2.RigDescription
    played: int = 0

    @property
    def play_key(self) -> str:
        return self.operator.keys.rig_play(RIG)

    def request(self) -> rig_pb2.PlayRequest:
        self.played += 1
        time_axis = np.arange(int(SECONDS * self.description.sample_rate)) / self.description.sample_rate
        fade = np.clip(np.minimum(time_axis, time_axis[::-1]), 0.0, 1.0)
        drive = 0.002 * np.sin(2.0 * np.pi * time_axis) * fade * np.ones((len(self.description.drives), 1))
        record = to_record(self.description.drives, self.description.sample_rate, drive)
        return rig_pb2.PlayRequest(run=f"run-{self.played}", drive=record, seed=3)

    def play(self, request: rig_pb2.PlayRequest) -> rig_pb2.PlayResult:
        return self.operator.query(self.play_key, request, rig_pb2.PlayResult)

    def state(self) -> rig_pb2.RigState:
        return self.operator.query(self.operator.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState)

    def log_lines(self) -> list[dict]:
        found = []
        for line in self.log.read_text(encoding="utf-8").splitlines():
            if line.startswith("{"):
                found.append(json.loads(line))
        return found

    def told(self, condition: Callable[[dict], bool]) -> dict:
        """Return the first line of the rig's log that fits."""
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            for line in self.log_lines():
                if condition(line):
                    return line
            time.sleep(0.05)
        raise AssertionError(f"the log says nothing of it; last: {self.log_lines()[-3:]}")

    @contextmanager
    def session(self, name: str) -> Iterator[zenoh.Session]:
        """Somebody with a certificate and none of our checks."""
        with zenoh.open(secured_config(self.router.endpoint, self.certificates, name)) as session:
            yield session


@pytest.fixture(scope="module")
def rig(router, certificates, tmp_path_factory) -> Iterator[SecuredRig]:
    folder = tmp_path_factory.mktemp("secured")
    services = {"rig_sim": {"rigs": [RIG], "bus": {"largest_payload_bytes": LARGEST}}}
    with running(
        services, endpoint=router.endpoint, certificates=certificates, folder=folder, wanted=[("rig_sim", RIG)]
    ) as operator:
        description = operator.query(
            operator.keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
        )
        yield SecuredRig(operator, router, certificates, folder / "rig_sim.log", description)


def ask_raw(session: zenoh.Session, key: str, payload: bytes, encoding: str = PLAY, seconds: float = 30.0):
    """Ask once; return the fault, the result's payload, or None where nothing came."""
    answer = None
    for reply in session.get(
        key,
        payload=payload,
        encoding=encoding,
        timeout=seconds,
        consolidation=zenoh.ConsolidationMode.NONE,
        congestion_control=zenoh.CongestionControl.BLOCK,
    ):
        if reply.err is not None:
            return query_pb2.Fault.FromString(reply.err.payload.to_bytes())
        if str(reply.ok.encoding) != encoding_of(query_pb2.Progress):
            answer = reply.ok.payload.to_bytes()
    return answer


def test_a_play_that_is_sent_again_byte_by_byte_moves_nothing(rig):
    request = rig.request()
    assert rig.play(request).blocks > 0
    with rig.session("operator.main") as again:
        fault = ask_raw(again, rig.play_key, request.SerializeToString())
    assert (fault.code, fault.field) == (query_pb2.FAULT_CODE_ALREADY_EXISTS, "run")
    assert [line["run"] for line in rig.log_lines() if line["event"] == "played"].count(request.run) == 1
    line = rig.told(lambda line: line.get("code") == "ALREADY_EXISTS")
    assert line["key"] == rig.play_key
    assert request.run in line["reason"]


def test_a_reset_that_is_sent_again_does_not_clear_a_later_latch(rig):
    keys, bus = rig.operator.keys, rig.operator
    reset = rig_pb2.ResetRequest(command="first-reset")
    bus.query(keys.rig_stop(RIG), rig_pb2.StopRequest(reason="a test"), rig_pb2.RigState)
    assert bus.query(keys.rig_reset(RIG), reset, rig_pb2.RigState).mode == rig_pb2.RIG_MODE_IDLE
    bus.query(keys.rig_stop(RIG), rig_pb2.StopRequest(reason="somebody is at the rig"), rig_pb2.RigState)
    with pytest.raises(FaultError) as caught:
        bus.query(keys.rig_reset(RIG), reset, rig_pb2.RigState)
    assert (caught.value.code_name, caught.value.field) == ("ALREADY_EXISTS", "command")
    assert rig.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
    assert bus.query(keys.rig_reset(RIG), rig_pb2.ResetRequest(command="second"), rig_pb2.RigState).mode == (
        rig_pb2.RIG_MODE_IDLE
    )
    # Our own client says which session asks; the router's log knows the certificate of that session.
    line = rig.told(lambda line: line.get("code") == "ALREADY_EXISTS" and line["key"] == keys.rig_reset(RIG))
    assert line["session"]
    assert any("CertCommonName(operator.main)" in said and line["session"] in said for said in rig.router.lines())


def test_a_viewer_is_told_at_once_that_it_may_only_watch(rig):
    with secured_bus(rig.router.endpoint, rig.certificates, "viewer.main") as viewer:
        with pytest.raises(FaultError, match=r"viewer\.main may not ask") as caught:
            viewer.query(rig.play_key, rig.request(), rig_pb2.PlayResult)
        assert caught.value.code_name == "PERMISSION_DENIED"
        with pytest.raises(FaultError, match="may not publish"):
            viewer.publisher(viewer.keys.rig_state(RIG))
        assert viewer.query(viewer.keys.rig_state(RIG), rig_pb2.StateRequest(), rig_pb2.RigState).rig == RIG


def test_a_viewer_who_goes_around_our_client_moves_nothing_and_is_logged(rig):
    before = len([line for line in rig.log_lines() if line["event"] == "played"])
    with rig.session("viewer.main") as viewer:
        session = str(viewer.info.zid())
        assert ask_raw(viewer, rig.play_key, rig.request().SerializeToString(), seconds=2.0) is None
        viewer.put(rig.operator.keys.rig_state(RIG), b"", encoding=encoding_of(rig_pb2.RigState))
        tried = {
            ("viewer.main", session, "Query", rig.play_key),
            ("viewer.main", session, "Put", rig.operator.keys.rig_state(RIG)),
        }
        logged = rig.router.refusals(lambda refused: tried <= _tried(refused))
    assert tried <= _tried(logged)
    assert len([line for line in rig.log_lines() if line["event"] == "played"]) == before


def _tried(refused: list[Refusal]) -> set[tuple[str, str, str, str]]:
    return {(each.who, each.session, each.what, each.key) for each in refused}


def test_malformed_requests_are_refused_and_logged(rig):
    sound = rig.request().SerializeToString()
    random = np.random.default_rng(5)
    with rig.session("operator.main") as session:
        for payload, encoding in (
            (random.bytes(200), PLAY),
            (sound[: len(sound) // 2], PLAY),
            (b"", PLAY),
            (sound, "application/protobuf;duralab.v1.Nothing"),
            (sound, ""),
        ):
            fault = ask_raw(session, rig.play_key, payload, encoding)
            assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT, payload[:20]
        # Whom a wildcard reaches is not for the asker to choose. The rig refuses it; its answer would speak for all
        # rigs, so that the router drops it.
        everyone = rig.operator.keys.rig_play("*")
        assert ask_raw(session, everyone, sound, seconds=5.0) is None
    rig.told(lambda line: line.get("code") == "INVALID_ARGUMENT" and "wildcard" in line.get("reason", ""))
    assert rig.state().mode == rig_pb2.RIG_MODE_IDLE
    rig.told(lambda line: line.get("code") == "INVALID_ARGUMENT" and line["key"] == rig.play_key)


def test_what_is_too_large_is_refused(rig):
    with rig.session("operator.main") as session:
        fault = ask_raw(session, rig.play_key, bytes(LARGEST + 1))
        assert fault.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
        assert f"at most {LARGEST}" in fault.message
        # Where requests are small the router keeps a large one from the service altogether.
        description = rig.operator.keys.rig_description(RIG)
        encoding = encoding_of(rig_pb2.DescriptionRequest)
        assert ask_raw(session, description, bytes(SMALL_QUERY_BYTES + 1), encoding, seconds=2.0) is None
        assert isinstance(ask_raw(session, description, b"", encoding), bytes)
    assert not any(line.get("key") == description and "bytes" in line.get("reason", "") for line in rig.log_lines())


@contextmanager
def flood(rig: SecuredRig, name: str, key: str, encoding: str) -> Iterator[list[int]]:
    """Ask without end from another process; afterwards the list holds how often."""
    asked: list[int] = []
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "tests.security.flooding_process",
            rig.router.endpoint,
            str(rig.certificates),
            name,
            key,
            encoding,
        ],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline().startswith("ready")
        yield asked
        process.stdin.close()
        asked.append(int(process.stdout.readline()))
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


@pytest.mark.parametrize(
    ("name", "what"), [("viewer.main", "description"), ("viewer.main", "play"), ("-", "links that are not secured")]
)
def test_a_playback_goes_on_under_a_flood(rig, name, what):
    quiet = rig.play(rig.request())
    key = rig.play_key if what == "play" else rig.operator.keys.rig_description(RIG)
    request = rig.request()
    with flood(rig, name, key, encoding_of(rig_pb2.DescriptionRequest)) as asked:
        began = time.monotonic()
        flooded = rig.play(request)
        stopped = rig.operator.query(
            rig.operator.keys.rig_stop(RIG), rig_pb2.StopRequest(reason="heard under a flood"), rig_pb2.RigState
        )
        seconds = time.monotonic() - began
    assert stopped.mode == rig_pb2.RIG_MODE_INTERLOCKED
    rig.operator.query(
        rig.operator.keys.rig_reset(RIG), rig_pb2.ResetRequest(command=f"after-{request.run}"), rig_pb2.RigState
    )
    # The very same bytes, and the flood was one: far more questions than a person asks.
    assert flooded.response.samples.data == quiet.response.samples.data
    assert asked[0] > 100 * seconds
    # A tenth of its pace is still several times real time on a quiet machine.
    assert flooded.real_time_factor > 0.02 * quiet.real_time_factor
