"""The router's configuration: made of the access table, closed by default, understood by Zenoh."""

import json
import re

import zenoh

from duralab_bus import router_configuration
from duralab_proto.keys import Keys
from duralab_proto.members import ADMIN, Member, Role

MEMBERS = (
    Member("rig", "front", ("front_axle",)),
    *(Member(role, "main") for role in Role if role is not Role.RIG),
    Member("operator", "ben", ("front_axle",)),
    Member("viewer", "guest", project="wheel"),
    Member(ADMIN, "main"),
)


def configured(*members, **settings):
    text = router_configuration(members or MEMBERS, version="1.10.2", **settings)
    return json.loads(re.sub(r"(?m)^//.*$", "", text))


def test_zenoh_reads_it_as_it_is(tmp_path):
    path = tmp_path / "zenohd.json5"
    path.write_text(router_configuration(MEMBERS, version="1.10.2"))
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
    content = configured(Member("operator", "anna"), Member("operator", "ben"), Member(ADMIN, "main"))
    named = {subject["id"]: subject for subject in content["access_control"]["subjects"]}
    assert {name: subject["cert_common_names"] for name, subject in named.items()} == {name: [name] for name in named}
    assert set(named) == {"operator.anna", "operator.ben", "admin.main"}
    assert named["admin.main"]["interfaces"] == ["lo"]
    assert all(subject["link_protocols"] == ["tls"] for subject in named.values())


def test_what_is_let_in_from_a_bound_member_is_on_its_own_keys():
    rules = configured()["access_control"]["rules"]
    served = [each for rule in rules if rule["id"] == "rig.front-serve-ingress" for each in rule["key_exprs"]]
    assert served
    assert all("/front_axle" in key for key in served)
    asked = {key for rule in rules if rule["id"] == "operator.ben-ask-ingress" for key in rule["key_exprs"]}
    assert Keys().rig_play("front_axle") in asked
    assert Keys().rig_play("*") not in asked
    (read,) = (rule["key_exprs"] for rule in rules if rule["id"] == "viewer.guest-ask-ingress")
    assert "duralab/v1/local/recorder/recording/wheel-$*/read" in read
    assert {rule["permission"] for rule in rules} == {"allow"}


def test_every_rule_belongs_to_a_member_and_lies_in_the_lab():
    content = configured(lab="west")["access_control"]
    used = [rule for policy in content["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(rule["id"] for rule in content["rules"])
    assert {policy["id"] for policy in content["policies"]} == {member.common_name for member in MEMBERS}
    for rule in content["rules"]:
        allowed = "@/**" if rule["id"].startswith("admin") else "duralab/v1/west/"
        assert all(key.startswith(allowed) for key in rule["key_exprs"])
        assert "delete" not in rule["messages"]


def test_a_large_request_is_let_through_where_a_record_travels():
    keys = Keys()
    (small,) = configured()["low_pass_filter"]
    for key in (keys.rig_play("a"), keys.campaign_start("a"), keys.commit(), keys.identify("a")):
        assert not any(zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key)) for expression in small["key_exprs"])
    assert keys.rig_description("*") in small["key_exprs"]
