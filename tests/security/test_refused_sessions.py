"""Who does not belong to the lab does not get in, and is told why in one sentence."""

from __future__ import annotations

import shutil
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh

from duralab.security import MemberEntry, configure_router, init_authority, issue, issue_missing, read_members
from duralab_bus import (
    BusConfig,
    BusError,
    BusMode,
    FaultError,
    TlsConfig,
    open_bus,
    router_configuration,
)
from duralab_proto.keys import Keys
from duralab_proto.members import Member, Role
from duralab_proto.v1 import rig_pb2

from .access_trials import secured_config
from .members import TRIED
from .secured_router import ROOT, SecuredRouter


def joining(endpoint: str, identity: Path) -> BusConfig:
    return BusConfig(mode=BusMode.CLIENT, connect=(endpoint,), connect_timeout_seconds=1.0, tls=TlsConfig.of(identity))


def refusal(endpoint: str, identity: Path) -> str:
    with pytest.raises(BusError) as caught, open_bus(joining(endpoint, identity), service="test"):
        pass
    return str(caught.value)


def expect_no_way_in(config: zenoh.Config) -> None:
    """Without any check of our own: Zenoh itself gets no session."""
    config.insert_json5("connect/timeout_ms", "1000")
    with pytest.raises(zenoh.ZError, match="Unable to connect"):
        zenoh.open(config)


@pytest.fixture(scope="module")
def strangers(tmp_path_factory) -> Path:
    """Certificates of another authority, with the very names of this lab."""
    folder = tmp_path_factory.mktemp("strangers")
    init_authority(folder)
    issue(folder, MemberEntry(role="operator", name="main"))
    issue(folder, MemberEntry(role="router", name="main"))
    return folder


def test_without_a_certificate_nobody_gets_in(router, certificates):
    expect_no_way_in(secured_config(router.endpoint, certificates, None))


def test_plain_tcp_does_not_get_in(router, certificates):
    endpoint = router.endpoint.replace("tls/", "tcp/")
    expect_no_way_in(secured_config(endpoint, certificates, None))
    with pytest.raises(BusError, match="answers but let this session not in") as caught:
        open_bus(BusConfig(mode=BusMode.CLIENT, connect=(endpoint,), connect_timeout_seconds=1.0), service="test")
    assert "secured" in str(caught.value)


def test_a_certificate_of_another_authority_does_not_get_in(router, certificates, strangers, tmp_path):
    expect_no_way_in(
        secured_config(
            router.endpoint,
            certificates,
            None,
            **{
                "transport/link/tls/connect_certificate": str(strangers / "operator.main.crt"),
                "transport/link/tls/connect_private_key": str(strangers / "operator.main.key"),
                "transport/link/tls/enable_mtls": True,
            },
        )
    )
    # One who trusts another authority is told that the router is not of that one.
    assert "its certificate is refused here" in refusal(router.endpoint, strangers / "operator.main")
    # One with this lab's authority beside a foreign certificate is told before anything is sent.
    for name in ("operator.main.crt", "operator.main.key"):
        shutil.copy(strangers / name, tmp_path / name)
    shutil.copy(certificates / "ca.crt", tmp_path / "ca.crt")
    assert "is not signed by" in refusal(router.endpoint, tmp_path / "operator.main")


def test_an_expired_certificate_does_not_get_in(router, certificates, tmp_path):
    folder = tmp_path / "certificates"
    shutil.copytree(certificates, folder)
    issue(folder, MemberEntry(role="operator", name="late"), days=1, begins=datetime.now(UTC) - timedelta(days=3))
    expect_no_way_in(secured_config(router.endpoint, folder, "operator.late"))
    said = refusal(router.endpoint, folder / "operator.late")
    assert "expired on" in said
    assert "duralab certs renew" in said


def test_a_link_is_closed_when_its_certificate_expires(certificates, router, tmp_path):
    folder = tmp_path / "certificates"
    shutil.copytree(certificates, folder)
    # Valid for some seconds more: a day that began a day ago, nearly.
    lifetime = timedelta(seconds=10)
    issue(
        folder,
        MemberEntry(role="viewer", name="main2"),
        days=1,
        begins=datetime.now(UTC) - timedelta(days=1) + lifetime,
    )
    with zenoh.open(secured_config(router.endpoint, folder, "viewer.main2")) as session:
        assert list(session.info.routers_zid())
        deadline = time.monotonic() + 60.0
        while list(session.info.routers_zid()):
            assert time.monotonic() < deadline, "the link is still open"
            time.sleep(0.1)


def test_the_certificate_of_a_client_does_not_make_a_router(certificates, tmp_path):
    folder = tmp_path / "certificates"
    shutil.copytree(certificates, folder)
    for suffix in ("crt", "key"):
        shutil.copy(folder / f"operator.main.{suffix}", folder / f"router.main.{suffix}")
    with SecuredRouter(folder, log=tmp_path / "router.log") as impostor:
        expect_no_way_in(secured_config(impostor.endpoint, certificates, "viewer.main"))
        assert "refused here" in refusal(impostor.endpoint, certificates / "viewer.main")


def test_a_router_under_another_name_is_not_trusted(certificates, tmp_path):
    folder = tmp_path / "certificates"
    shutil.copytree(certificates, folder)
    for suffix in ("crt", "key"):
        (folder / f"router.main.{suffix}").unlink()
    issue(folder, MemberEntry(role="router", name="main", hosts=("lab.example.org",)))
    with SecuredRouter(folder, log=tmp_path / "router.log") as router:
        said = refusal(router.endpoint, certificates / "viewer.main")
        assert "mismatch" in said
        assert "issued for" in said


def test_a_withdrawn_holder_gets_nothing_though_the_certificate_is_valid(certificates, tmp_path):
    left = [member for member in TRIED if member != Member("operator", "main")]
    configuration = tmp_path / "zenohd.json5"
    configuration.write_text(router_configuration(left, version="1.10.2"))
    with SecuredRouter(certificates, log=tmp_path / "router.log", configuration=configuration) as router:
        viewer = open_bus(joining(router.endpoint, certificates / "viewer.main"), service="test")
        with viewer, open_bus(joining(router.endpoint, certificates / "rig.main"), service="rig_sim") as rig:
            rig.serve(rig.keys.rig_description("a"), rig_pb2.DescriptionRequest, lambda *_: rig_pb2.RigDescription())
            rig.declare_live("rig_sim", "a")
            viewer.wait_for_live({("rig_sim", "a")}, 20.0)
            with open_bus(joining(router.endpoint, certificates / "operator.main"), service="test") as withdrawn:
                assert withdrawn.discover() == set()
                with pytest.raises(FaultError, match="no rig") as caught:
                    withdrawn.query(
                        withdrawn.keys.rig_description("a"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
                    )
                assert "UNAVAILABLE" in caught.value.code_name
        assert any("did not match any configured ACL subject" in line for line in router.lines())


def test_a_bound_operator_starts_campaigns_on_its_own_rig_though_the_service_declares_all(router, certificates):
    keys, asked = Keys(), []

    def answer(query: zenoh.Query) -> None:
        with query:
            asked.append(str(query.key_expr))
            query.reply(query.key_expr, b"answered")

    with (
        zenoh.open(secured_config(router.endpoint, certificates, "iterator.main")) as iterator,
        zenoh.open(secured_config(router.endpoint, certificates, "operator.ben")) as ben,
    ):
        iterator.declare_queryable(keys.campaign_start("*"), answer)
        own, foreign, every = (keys.campaign_start(rig) for rig in ("a", "b", "*"))
        deadline = time.monotonic() + 20.0
        while not any(reply.ok is not None for reply in ben.get(own, timeout=1.0)):
            assert time.monotonic() < deadline
        for key in (foreign, every):
            assert not [reply for reply in ben.get(key, timeout=2.0) if reply.ok is not None]
    assert set(asked) == {own}


def test_the_routers_own_space_is_open_to_the_admin_on_its_machine_only(router, certificates):
    def answers(name: str) -> int:
        with zenoh.open(secured_config(router.endpoint, certificates, name)) as session:
            return len(list(session.get("@/*/router", timeout=3.0)))

    assert answers("admin.main") == 1
    assert [answers(f"{role}.main") for role in (Role.OPERATOR, Role.VIEWER)] == [0, 0]


def test_a_viewer_cannot_take_everything_with_a_wildcard(router, certificates):
    keys = Keys()
    came: list[str] = []
    with (
        zenoh.open(secured_config(router.endpoint, certificates, "viewer.main")) as viewer,
        zenoh.open(secured_config(router.endpoint, certificates, "recorder.main")) as recorder,
        zenoh.open(secured_config(router.endpoint, certificates, "rig.main")) as rig,
    ):
        viewer.declare_subscriber("**", lambda sample: came.append(str(sample.key_expr)))
        viewer.declare_subscriber("duralab/**", lambda sample: came.append(str(sample.key_expr)))
        proof: list[str] = []
        rig.declare_subscriber(f"{keys.rig_pose('a')}/@mark", lambda sample: proof.append(str(sample.key_expr)))
        deadline = time.monotonic() + 20.0
        while not proof and time.monotonic() < deadline:
            recorder.put(f"{keys.rig_pose('a')}/@mark", b"")
            time.sleep(0.1)
        assert proof
        assert came == []


def test_the_shipped_configuration_is_what_the_commands_make(tmp_path):
    shipped = ROOT / "deploy" / "router"
    members = read_members(shipped / "members.yaml")
    init_authority(tmp_path)
    issue_missing(tmp_path, members)
    made = configure_router(tmp_path, members, certificates="/etc/duralab/certificates")
    assert made == (shipped / "zenohd.json5").read_text(encoding="utf-8")
