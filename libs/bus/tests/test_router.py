"""The router's configuration: made of the access table, closed by default, understood by Zenoh."""

import json
import re

import zenoh

from duralab_bus import DEFAULT_HOLDERS, router_configuration
from duralab_proto.access import ADMIN, Holder, Role
from duralab_proto.keys import Keys


def configured(*holders, **settings):
    text = router_configuration(holders or DEFAULT_HOLDERS, version="1.10.2", **settings)
    return json.loads(re.sub(r"(?m)^//.*$", "", text))


def test_zenoh_reads_it_as_it_is(tmp_path):
    path = tmp_path / "zenohd.json5"
    path.write_text(router_configuration(version="1.10.2"))
    config = zenoh.Config.from_file(str(path))
    assert json.loads(config.get_json("access_control"))["default_permission"] == "deny"
    tls = json.loads(config.get_json("transport/link/tls"))
    assert [tls[name] for name in ("enable_mtls", "verify_name_on_connect", "close_link_on_expiration")] == [True] * 3
    assert json.loads(config.get_json("transport/link/protocols")) == ["tls"]


def test_nothing_finds_it_by_chance_and_nothing_may_be_changed_in_it():
    content = configured()
    assert not content["scouting"]["multicast"]["enabled"]
    assert not content["scouting"]["gossip"]["enabled"]
    assert content["adminspace"]["permissions"] == {"read": True, "write": False}
    assert content["timestamping"]["enabled"]["router"]
    assert content["transport"]["unicast"]["max_sessions"] <= 100


def test_everyone_is_named_and_nobody_stands_for_all():
    subjects = configured(Holder("operator", "anna"), Holder("operator", "ben"), Holder(ADMIN, "main"))
    named = {subject["id"]: subject for subject in subjects["access_control"]["subjects"]}
    assert named["operator"]["cert_common_names"] == ["operator.anna", "operator.ben"]
    assert named["admin"]["interfaces"] == ["lo"]
    assert all(subject["cert_common_names"] and subject["link_protocols"] == ["tls"] for subject in named.values())
    assert set(named) == {"operator", "admin"}


def test_every_rule_belongs_to_a_role_and_lies_in_the_lab():
    content = configured(lab="west")["access_control"]
    used = [rule for policy in content["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(rule["id"] for rule in content["rules"])
    assert {policy["id"] for policy in content["policies"]} == {*(role.value for role in Role), "admin"}
    for rule in content["rules"]:
        allowed = "@/**" if rule["id"].startswith("admin") else "duralab/v1/west/"
        assert all(key.startswith(allowed) for key in rule["key_exprs"])
        assert "delete" not in rule["messages"]


def test_a_large_request_is_let_through_where_a_record_travels():
    keys = Keys()
    (small,) = configured()["low_pass_filter"]
    for key in (keys.rig_play("a"), keys.campaign_start(), keys.commit(), keys.identify()):
        assert not any(zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key)) for expression in small["key_exprs"])
    assert keys.rig_description("*") in small["key_exprs"]
