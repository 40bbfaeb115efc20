"""Members of a lab: what a certificate says of them, and what cannot be one."""

import pytest

from duralab_proto.members import Member, MemberError

BOUND = Member("operator", "ben", ("front_axle", "beam"))


def test_a_member_is_a_role_and_a_name():
    assert Member.parse("operator.anna") == Member("operator", "anna")
    assert Member("iterator", "hall-2").common_name == "iterator.hall-2"


@pytest.mark.parametrize(
    "member", [BOUND, Member("rig", "front", ("front_axle",)), Member("viewer", "a", project="wheel")]
)
def test_what_a_member_is_bound_to_comes_back_out_of_its_certificate(member):
    assert Member.parse(member.common_name, member.bindings) == member


def test_what_binds_nobody_stands_in_no_certificate():
    assert Member("operator", "anna").bindings == ()


@pytest.mark.parametrize(
    "name", ["operator", "boss.anna", "operator.", "operator.Anna", "operator.a b", "operator." + "a" * 59]
)
def test_a_common_name_that_names_no_member_is_refused_in_one_sentence(name):
    with pytest.raises(MemberError) as caught:
        Member.parse(name)
    assert str(caught.value).count(". ") == 0


@pytest.mark.parametrize(
    ("role", "rigs", "project", "said"),
    [
        ("rig", (), "", "rig.a names no rigs"),
        ("rig", ("beam", "beam"), "", "names a rig twice"),
        ("rig", ("Beam",), "", "'Beam' is not a name"),
        ("rig", ("*",), "", "not a name"),
        ("rig", ("beam",), "wheel", "only a viewer is bound"),
        ("viewer", ("beam",), "", "only members of role rig or operator"),
        ("viewer", (), "wheel-2", "'wheel-2' is not a name"),
        ("viewer", (), "list", "is taken by the contract"),
        ("operator", (), "wheel", "only a viewer"),
        ("recorder", ("beam",), "", "only members of role rig or operator"),
    ],
)
def test_a_binding_that_its_role_does_not_know_is_refused(role, rigs, project, said):
    with pytest.raises(MemberError, match=said) as caught:
        Member(role, "a", rigs, project)
    assert str(caught.value).count(". ") == 0


@pytest.mark.parametrize(
    ("bindings", "said"),
    [
        (["urn:other:rig:beam"], "binds it to no rig or project"),
        (["urn:duralab:lab:west"], "binds it to no rig or project"),
        (["urn:duralab:rig"], "binds it to no rig or project"),
        (["urn:duralab:project:a", "urn:duralab:project:b"], "2 projects; one"),
    ],
)
def test_a_certificate_with_another_binding_names_no_member(bindings, said):
    with pytest.raises(MemberError, match=said):
        Member.parse("viewer.guest", bindings)
