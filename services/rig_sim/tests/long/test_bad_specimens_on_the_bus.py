"""Specimens that cannot be used, beside one that can: a sentence for whoever asks, and the service stays up."""

import re
import subprocess
import sys

import numpy as np
import pytest
import yaml

import duralab_bus
from duralab_proto.arrays import from_record, to_record
from duralab_proto.v1 import rig_pb2
from rig_sim import shipped_specimens

WAIT = 120.0
GOOD = "predecessor"

#: Name: the shipped rig that is spoiled, which pattern in its YAML and in its SDF becomes what, and what is said of it.
SPOILED = {
    "swings": (
        "macpherson_compliant",
        ("proportional: 65.0", "proportional: 650.0"),
        None,
        r"the rig is unstable: from its rest, '\w+ state \d' swings up at 9\d\.\d Hz, growing e-fold in ",
    ),
    "spring_rate": (
        "predecessor",
        (r"stiffness: 4\.6e\+4", "stiffness: -4.6e+4"),
        None,
        r"specimen spring_rate\.yaml: struts\.0\.law\.stiffness is -46000\.0; it must be greater than 0",
    ),
    "bushing_rate": (
        "predecessor",
        None,
        ("<drake:bushing_force_stiffness>", "<drake:bushing_force_stiffness>-"),
        r"force_stiffness of a linear_bushing_rpy is '-1000000 2200000 2200000'; it takes 3 constants of 0 or more",
    ),
    "massless": (
        "macpherson_compliant",
        None,
        ("<mass>", "<mass>0.0</mass><mass>"),
        r"link 'body' has the mass '0\.0'",
    ),
    "unknown_tag": (
        "macpherson_compliant",
        None,
        ('<link name="left_knuckle">', '<link name="left_knuckle"><spring>3</spring>'),
        r"Element\[spring\], child of element\[link\], not defined in SDF",
    ),
    "unconnected": (
        "macpherson_compliant",
        None,
        ("_body_A>left_lateral_piston<", "_body_A>left_knuckle<"),
        r"actuator 'left_lateral' moves 'left_lateral_piston', to which nothing is connected",
    ),
    "twins": (
        "macpherson_compliant",
        ("name: right_lateral, transducer", "name: left_lateral, transducer"),
        None,
        r"two responses are called 'left_lateral'; names must differ",
    ),
    "too_stiff": (
        "front_axle_compliant",
        (r"sample_rate: .*\nsubsteps: \d+", "sample_rate: 400.0\nsubsteps: 1"),
        None,
        r"the step of 2\.5 ms \(1 substeps\) is unstable: '\w+ velocity 0' is too stiff for it .* take substeps: \d",
    ),
}


def spoil(text, change):
    if change is None:
        return text
    pattern, replacement = change
    spoilt, count = re.subn(pattern, replacement, text, count=1)
    assert count == 1
    return spoilt


def write_all(folder):
    paths = []
    for name, (base, in_yaml, in_sdf, _) in SPOILED.items():
        place = folder / name
        place.mkdir()
        source = shipped_specimens()[base]
        text = source.read_text().replace(f"name: {base}\n", f"name: {name}\n", 1)
        (place / f"{name}.yaml").write_text(spoil(text, in_yaml))
        sdf = source.with_name(yaml.safe_load(text)["sdf"])
        (place / sdf.name).write_text(spoil(sdf.read_text(), in_sdf))
        paths.append(str(place / f"{name}.yaml"))
    broken = folder / "Not a rig.yaml"
    broken.write_text("{")
    return [*paths, str(broken)]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    with duralab_bus.open_bus(service="client") as bus:
        config = folder / "rig_sim.yaml"
        content = {"bus": {"connect": list(bus.listening)}, "rigs": [GOOD], "specimens": write_all(folder)}
        config.write_text(yaml.safe_dump(content))
        command = [sys.executable, "-m", "rig_sim", "--config", str(config)]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        try:
            bus.wait_for_live({("rig_sim", name) for name in (GOOD, "rig_not_a_rig", *SPOILED)}, WAIT)
            yield bus, process
        finally:
            process.terminate()
            assert process.wait(WAIT) == 0


def fault_of(bus, key, request, answer):
    with pytest.raises(duralab_bus.FaultError) as caught:
        bus.query(key, request, answer)
    return caught.value


@pytest.mark.parametrize("name", SPOILED)
def test_whoever_asks_a_bad_rig_is_told_what_is_wrong_with_it(lab, name):
    bus, process = lab
    keys = bus.keys
    for key, request, answer in (
        (keys.rig_description(name), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription),
        (keys.rig_play(name), rig_pb2.PlayRequest(run="first"), rig_pb2.PlayResult),
        (keys.rig_state(name), rig_pb2.StateRequest(), rig_pb2.RigState),
        (keys.rig_stop(name), rig_pb2.StopRequest(), rig_pb2.RigState),
    ):
        fault = fault_of(bus, key, request, answer)
        assert fault.code_name == "FAILED_PRECONDITION"
        assert re.fullmatch(f"{name} cannot be used: .*{SPOILED[name][3]}.*\\.", fault.message), fault.message
    assert process.poll() is None


def test_a_file_that_is_no_specimen_has_a_name_to_ask_for(lab):
    bus, _ = lab
    asked = bus.keys.rig_description("rig_not_a_rig")
    fault = fault_of(bus, asked, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    assert fault.message.startswith("rig_not_a_rig cannot be used: specimen Not a rig.yaml is not YAML: ")


def test_the_good_rig_beside_them_plays(lab):
    bus, _ = lab
    told = bus.query(bus.keys.rig_description(GOOD), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    request = rig_pb2.PlayRequest(run="good", drive=to_record(told.drives, 1000.0, np.zeros((8, 200))))
    result = bus.query(bus.keys.rig_play(GOOD), request, rig_pb2.PlayResult)
    assert np.isfinite(from_record(result.response)[2]).all()


def test_a_drive_with_a_jump_is_refused_and_the_service_stays_up(lab):
    bus, process = lab
    told = bus.query(bus.keys.rig_description(GOOD), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    drive = np.zeros((8, 200))
    drive[0, 100:] = 1e6
    request = rig_pb2.PlayRequest(run="jump", drive=to_record(told.drives, 1000.0, drive))
    fault = fault_of(bus, bus.keys.rig_play(GOOD), request, rig_pb2.PlayResult)
    assert (fault.code_name, fault.field) == ("INVALID_ARGUMENT", "drive.samples")
    assert "left_height is 1e+06 m at 0.100 s, allowed -0.3 to 0.3" in fault.message
    assert process.poll() is None
