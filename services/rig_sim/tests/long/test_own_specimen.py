"""A specimen of the user's own: the guide followed to the letter, the same as a URDF, and what is refused."""

import contextlib
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import duralab_bus
from rig_sim import SpecimenError, load_rig
from rig_sim.checks.equilibrium import NoEquilibriumError, UnstableError, check_stability

GUIDE = Path(__file__).resolve().parents[4] / "docs" / "guides" / "own-specimen.md"
# The campaign needs the other services: tests/long/test_own_specimen_campaign.py runs it.
TEXT = GUIDE.read_text(encoding="utf-8").partition("## 5. ")[0]
FILES = dict(re.findall(r"```\w+ file=(\S+)\n(.*?)```", TEXT, flags=re.S))
OUTPUT = re.findall(r"```text output=try\.py\n(.*?)```", TEXT, flags=re.S)[0]
COMMAND = re.findall(r"```console background\n\$ (.*?)\n```", TEXT, flags=re.S)[0]
PORT = "tcp/127.0.0.1:7474"


def written(folder, **changes):
    """Write the guide's files; a change is (old, new) in the file of that ending."""
    for name, shown in FILES.items():
        content = shown
        for old, new in changes.get(name.partition(".")[2], []):
            assert old in content
            content = content.replace(old, new)
        (folder / name).write_text(content)
    return folder / "quarter_car.yaml"


def free_endpoint():
    with duralab_bus.open_bus(service="client") as bus:
        return bus.listening[0]


def wait_until_it_serves(endpoint, process):
    """Wait as a reader of its log does, for at most a minute."""
    port = int(endpoint.rpartition(":")[2])
    for _ in range(300):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
            return
        assert process.poll() is None
        time.sleep(0.2)


def test_the_guide_gives_what_it_states(tmp_path):
    assert set(FILES) == {"quarter_car.sdf", "quarter_car.yaml", "lab.yaml", "try.py"}
    # The page names the default port; tests use a free one.
    endpoint = free_endpoint()
    written(tmp_path, yaml=[], py=[(PORT, endpoint)])
    (tmp_path / "lab.yaml").write_text(FILES["lab.yaml"].replace(PORT, endpoint))
    python, *arguments = COMMAND.split()
    assert python == "python"
    process = subprocess.Popen([sys.executable, *arguments], cwd=tmp_path, stderr=subprocess.DEVNULL)
    try:
        wait_until_it_serves(endpoint, process)
        tried = subprocess.run(
            [sys.executable, "-W", "error", "try.py"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    finally:
        process.terminate()
        process.wait(60.0)
    assert tried.returncode == 0, tried.stderr
    assert tried.stdout == OUTPUT


def urdf():
    """Return the guide's quarter car as a URDF."""

    def link(name, mass, inertia):
        ixx, iyy, izz = inertia
        return (
            f'<link name="{name}"><inertial><mass value="{mass}"/>'
            f'<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial></link>'
        )

    def joint(name, kind, parent, child, height):
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="0 0 1"/><limit effort="0" velocity="0"/></joint>'
        )

    return "".join(
        [
            '<robot name="quarter_car" xmlns:drake="https://drake.mit.edu"><link name="world"/>',
            link("body", 330, (20, 20, 20)),
            link("knuckle", 20, (0.3, 0.3, 0.3)),
            link("wheel", 20, (0.5, 0.9, 0.5)),
            link("piston", 20, (0.1, 0.1, 0.1)),
            joint("body_heave", "prismatic", "world", "body", 0.8),
            joint("wheel_hop", "prismatic", "world", "knuckle", 0.3),
            joint("wheel_force_transducer", "fixed", "knuckle", "wheel", 0),
            joint("stroke", "prismatic", "world", "piston", 0),
            '<frame name="pan" link="piston" xyz="0 0 0" rpy="0 0 0"/>',
            '<frame name="contact" link="wheel" xyz="0 0 -0.3" rpy="0 0 0"/>',
            '<drake:linear_bushing_rpy><drake:bushing_frameA name="pan"/><drake:bushing_frameC name="contact"/>',
            '<drake:bushing_torque_stiffness value="0 0 0"/><drake:bushing_torque_damping value="0 0 0"/>',
            '<drake:bushing_force_stiffness value="0 0 2.1e5"/><drake:bushing_force_damping value="0 0 150"/>',
            "</drake:linear_bushing_rpy></robot>",
        ]
    )


def urdf_rig(folder, content):
    path = written(folder, yaml=[])
    path.write_text(path.read_text().replace("quarter_car.sdf", "quarter_car.urdf"))
    (folder / "quarter_car.urdf").write_text(content)
    return load_rig(path)


def test_a_urdf_gives_the_rig_that_its_sdf_gives(tmp_path):
    other, own = load_rig(written(tmp_path)), urdf_rig(tmp_path, urdf())
    np.testing.assert_allclose(own.static_response, other.static_response, rtol=1e-9)
    state = other.rest + 0.01 * np.random.default_rng(0).standard_normal(len(other.rest))
    np.testing.assert_allclose(
        own.compiled.derivative(state, np.array([0.01])), other.compiled.derivative(state, np.array([0.01])), rtol=1e-9
    )
    assert own.content_hash != other.content_hash


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<frame ", "<spring/><frame ", "tag 'spring' in robot 'quarter_car' is unknown; known there are drake:joint"),
        ("</inertial></link>", "</inertial><mesh/></link>", "tag 'mesh' in link 'body' is unknown"),
        (
            '<mass value="20"/>',
            '<mass value="0"/>',
            "link 'knuckle' has the mass '0'; what moves needs a mass above 0 kg",
        ),
        ("</robot>", "", "is not XML"),
        ("robot", "sdf", "begins with the tag 'sdf'; a URDF begins with 'robot'"),
    ],
)
def test_a_bad_urdf_is_refused_in_one_sentence(tmp_path, old, new, said):
    with pytest.raises(SpecimenError, match=said) as caught:
        urdf_rig(tmp_path, urdf().replace(old, new))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("sdf", '<link name="piston">', '<link name="piston"><spring>3</spring>', "not defined in SDF"),
        ("sdf", "drake:linear_bushing_rpy", "drake:linear_bushing", "Unsupported SDFormat element"),
        ("sdf", "<mass>330</mass>", "<mass>0</mass>", "link 'body' has the mass '0'"),
        ("sdf", "<mass>330</mass>", "", "link 'body' has no inertial with a mass"),
        ("sdf", ">pan<", ">plate<", "plate"),
        ("sdf", ">0 0 2.1e5<", ">0 2.1e5<", "is '0 2.1e5'; it takes 3 constants of 0 or more"),
        ("yaml", "joint: stroke", "joint: pan", "joint 'pan' is not in the specimen"),
    ],
)
def test_a_bad_sdf_or_yaml_is_refused_in_one_sentence(tmp_path, file, old, new, said):
    path = written(tmp_path)
    target = tmp_path / f"quarter_car.{file}"
    target.write_text(target.read_text().replace(old, new))
    with pytest.raises(SpecimenError, match=re.escape(said)) as caught:
        load_rig(path)
    assert str(caught.value).startswith("specimen quarter_car: ")
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
    assert str(tmp_path) not in str(caught.value)


def test_a_piston_that_nothing_hangs_on_is_named(tmp_path):
    path = written(tmp_path)
    sdf = tmp_path / "quarter_car.sdf"
    # The tyre hangs on the body instead.
    sdf.write_text(sdf.read_text().replace('attached_to="piston"', 'attached_to="body"'))
    with pytest.raises(SpecimenError, match="actuator 'vertical' moves 'piston', to which nothing is connected"):
        load_rig(path)


def test_two_responses_of_one_name_are_refused(tmp_path):
    path = written(tmp_path)
    text = path.read_text().rstrip("\n")
    path.write_text(f"{text}\n{text.splitlines()[-1]}\n")
    with pytest.raises(SpecimenError, match="two responses are called 'vertical'"):
        load_rig(path)


def test_a_body_that_nothing_carries_finds_no_rest(tmp_path):
    path = written(tmp_path)
    text = path.read_text()
    begin, end = text.index("struts:"), text.index("drives:")
    path.write_text(text[:begin] + text[end:])
    with pytest.raises(NoEquilibriumError, match=r"finds no rest: 'body_heave velocity 0' still changes by -9\.81"):
        load_rig(path)


def test_a_rest_that_is_left_by_itself_is_named():
    # A pendulum standing on its head: θ'' = g/l θ.
    falling, hanging = np.array([[0.0, 1.0], [9.81, 0.0]]), np.array([[0.0, 1.0], [-9.81, 0.0]])
    names = ("pendulum position 0", "pendulum velocity 0")
    check_stability(hanging, names)
    with pytest.raises(UnstableError, match=r"'pendulum velocity 0' falls away, growing e-fold in 0\.319 s"):
        check_stability(falling, names)
