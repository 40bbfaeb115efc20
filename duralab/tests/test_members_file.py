"""members.yaml: what it may say, and that what is wrong in it is one sentence with the member and the remedy."""

import pytest

from duralab.errors import InputError
from duralab.security import read_members
from duralab_proto.members import Member

SOUND = """
members:
  - {role: router, name: main, hosts: [lab.example.org]}
  - {role: rig, name: front, rigs: [front_axle]}
  - {role: operator, name: ben, rigs: [front_axle, beam]}
  - {role: viewer, name: guest, project: wheel}
"""


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "members.yaml"
        path.write_text(text)
        return path

    return write


def test_members_are_read_as_they_stand(written):
    entries = read_members(written(SOUND))
    assert [entry.member for entry in entries] == [
        Member("router", "main"),
        Member("rig", "front", ("front_axle",)),
        Member("operator", "ben", ("front_axle", "beam")),
        Member("viewer", "guest", project="wheel"),
    ]
    assert entries[0].hosts == ("lab.example.org",)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{role: boss, name: anna}", "The role 'boss' is not one of"),
        ("{role: operator, name: ../anna}", "lower case letters"),
        ("{role: operator, name: anna, hosts: [lab]}", "operator.anna names hosts"),
        ("{role: operator, name: anna, rig: [beam]}", "rig"),
        ("{role: operator, name: anna, rigs: beam}", "members.4.rigs"),
        ("{role: operator, name: anna, rigs: [1]}", "members.4.rigs"),
        ("{role: operator, name: 7}", "members.4.name"),
        ("{name: anna}", "role"),
        ("{role: rig, name: second}", "rig.second names no rigs"),
        (
            "{role: rig, name: second, rigs: [beam, front_axle]}",
            "rig.front and rig.second both speak for rig 'front_axle'",
        ),
        ("{role: operator, name: ben}", "operator.ben is listed 2 times"),
        ("{role: router, name: second}", "2 routers are listed; one is needed"),
        ("{role: viewer, name: hall, project: wheel-2}", "'wheel-2' is not a name"),
    ],
)
def test_a_wrong_member_is_refused_in_one_sentence(written, line, said):
    with pytest.raises(InputError) as caught:
        read_members(written(f"{SOUND}  - {line}\n"))
    assert said in caught.value.message
    assert "members.yaml" in caught.value.message
    assert "\n" not in caught.value.message


@pytest.mark.parametrize("text", ["", "members:", "members: []", "[]", "members: [", "people: []", "members: [3]"])
def test_a_file_without_members_is_refused_in_one_sentence(written, text):
    with pytest.raises(InputError) as caught:
        read_members(written(text))
    assert "\n" not in caught.value.message
