"""What the sensors say: against Drake at load, found out when mounted wrongly, and against what was played."""

import dataclasses
import shutil

import numpy as np
import pytest
import yaml

from rig_sim import load_rig, shipped_specimens
from rig_sim.checks.equilibrium import find_equilibrium
from rig_sim.checks.proof import ProofError, prove
from rig_sim.compile.model import compile_model
from rig_sim.engines.drake_engine import drake_responses
from rig_sim.model.assembly import assemble
from rig_sim.model.measurement import Accelerometer, BushingForce, SpindleMoment
from rig_sim.model.rig_model import RigModel
from rig_sim.multibody.drake_reader import load_plant
from rig_sim.multibody.kinematics import move
from rig_sim.specimen.responses import SpindleChannel
from rig_sim.specimen.specimen import SpecimenError, load_specimen, read_document

MOMENTS = tuple(
    SpindleChannel(
        name=f"{side}_moment_{axis}",
        transducer=f"{side}_wheel_force_transducer",
        axis=axis,
        quantity="moment",
        range=5e3,
        noise_rms=0.5,
        label="moment",
    )
    for side in ("left", "right")
    for axis in "xyz"
)


@pytest.fixture(scope="module")
def plant():
    return load_plant(shipped_specimens()["front_axle"].with_suffix(".sdf"))


@pytest.fixture(scope="module")
def model(front_axle):
    """Return the front axle with every kind of sensor, moments too."""
    specimen = load_specimen(shipped_specimens()["front_axle_sensors"])
    specimen = specimen.model_copy(update={"responses": (*specimen.responses, *MOMENTS)})
    return RigModel(assemble(specimen, front_axle.model.assembly.tree))


def compiled(model):
    return compile_model(
        model.traced, state_names=model.state_names, input_names=model.input_names, output_names=model.output_names
    )


def row(model, name):
    return model.response_names.index(name)


def test_every_kind_of_sensor_agrees_with_drake(model, plant):
    assert {channel.unit for channel in model.assembly.specimen.responses} == {"N", "N*m", "m/s^2", "m"}
    assert prove(model, compiled(model), plant).force_error < 1e-11


def _nearer(sensor):
    return dataclasses.replace(sensor, point=sensor.point * 0.999)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("left_moment_y", lambda sensor: dataclasses.replace(sensor, row=2)),
        ("left_knuckle_vertical_acceleration", lambda sensor: dataclasses.replace(sensor, body=sensor.body - 1)),
        ("right_knuckle_lateral_acceleration", _nearer),
        ("left_strut_travel", lambda sensor: dataclasses.replace(sensor, point_a=sensor.point_a * 1.001)),
        ("right_lower_rear_lateral", lambda sensor: dataclasses.replace(sensor, row=0)),
    ],
)
def test_a_sensor_mounted_wrongly_does_not_start(model, plant, name, change):
    index = row(model, name)
    sensors = list(model.assembly.transducers)
    sensors[index] = change(sensors[index])
    wrong = RigModel(dataclasses.replace(model.assembly, transducers=tuple(sensors)))
    # Drake is asked where the struts' ends are, which only the assembly knows: it keeps the right ones.
    right = wrong if name != "left_strut_travel" else model
    with pytest.raises(ProofError, match=repr(name)):
        prove(right, compiled(wrong), plant)


def test_an_accelerometer_says_how_the_velocity_of_its_point_changes(model):
    rig, specimen = compiled(model), model.assembly.specimen
    rest = find_equilibrium(model, rig.derivative, np.zeros(6))
    index = row(model, "left_knuckle_vertical_acceleration")
    np.testing.assert_allclose(rig.outputs(rest, np.zeros(6))[index], 0.0, atol=1e-6)
    time = np.arange(200) / specimen.sample_rate
    drive = np.zeros((6, 200))
    drive[0] = 0.01 * (1 - np.cos(2 * np.pi * 10 * time))
    state = rig.play(rest, drive[:, :120], sample_interval=1e-3, substeps=4).state
    value, rates = rig.outputs(state, drive[:, 119])[index], rig.derivative(state, drive[:, 119])
    tree, sensor = model.assembly.tree, model.assembly.transducers[index]
    n_q, n_v = model.position_count, model.assembly.tree.velocity_count

    def velocity(seconds):
        moved = state + seconds * rates
        return move(tree, moved[:n_q], moved[n_q : n_q + n_v]).point(sensor.body, sensor.point)[1]

    change = (velocity(1e-6) - velocity(-1e-6)) / 2e-6
    axes = move(tree, state[:n_q], state[n_q : n_q + n_v]).poses[sensor.body].rotation
    assert abs(value) > 1.0
    assert value == pytest.approx((axes.T @ change)[2], rel=1e-6)


def test_the_moment_at_the_spindle_is_that_of_what_pushes_the_wheel_off_its_centre(model):
    # At rest the wheel hangs on three rods through its centre: its own weight off the centre is all that turns it.
    rig = compiled(model)
    rest = find_equilibrium(model, rig.derivative, np.zeros(6))
    outputs = rig.outputs(rest, np.zeros(6))
    force = np.abs(outputs[:6]).max()
    moments = [outputs[row(model, channel.name)] for channel in MOMENTS]
    # The rods tilt by a few milliradians at their ends 0.16 m from the centre.
    assert np.abs(moments).max() < 0.02 * 0.16 * force


def test_a_load_cell_feels_the_rubber_beside_its_bushing(model, plant):
    index = row(model, "left_lower_rear_lateral")
    sensor = model.assembly.transducers[index]
    assert isinstance(sensor, BushingForce)
    assert [rubber.name for rubber in sensor.rubber] == ["left_lower_rear_x", "left_lower_rear_y"]
    state = model.design_state.copy()
    plain = model.evaluate(state, np.zeros(6)).responses[index]
    state[model.element_slice("left_lower_rear_y").start] = 0.5
    stuck = model.evaluate(state, np.zeros(6)).responses[index]
    # Frame C is held back by half of 60 N; the mount feels the opposite.
    assert stuck - plain == pytest.approx(0.5 * 60.0, rel=1e-9)
    context = plant.CreateDefaultContext()
    assert drake_responses(model, plant, context, state, np.zeros(6))[index] == pytest.approx(stuck, rel=1e-9, abs=1e-9)


def test_a_strut_that_gets_shorter_shows_a_positive_travel(model):
    rig = compiled(model)
    index, time = row(model, "left_strut_travel"), np.arange(300) / 1000.0
    drive = np.zeros((6, 300))
    drive[0] = 0.02 * np.minimum(time / 0.2, 1.0)
    rest = find_equilibrium(model, rig.derivative, np.zeros(6))
    travel = rig.play(rest, drive, sample_interval=1e-3, substeps=2).outputs[index]
    # 20 mm at the wheel, seven tenths of it at the strut's foot.
    assert 0.010 < travel[-1] - travel[0] < 0.018


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"body": "left_arm", "point": [0, 0, 0], "axis": "x"}, "body 'left_arm' is not in the specimen"),
        ({"body": "world", "point": [0, 0, 0], "axis": "x"}, "on the world, which does not move"),
        ({"body": "left_knuckle", "axis": "x"}, "responses.6.point is missing"),
        ({"strut": "left_damper"}, "is on strut 'left_damper'; there are left_strut, right_strut"),
        ({"frame_a": "left_lower_rear_mount", "frame_c": "right_lower_rear_eye", "axis": "y"}, "has 0 of them"),
        ({"transducer": "left_lower_ball", "axis": "x", "quantity": "moment"}, "is a weld"),
        ({"transducer": "left_wheel_force_transducer", "axis": "x", "quantity": "power"}, "responses.6.quantity is"),
        ({"gauge": "left_strut"}, "responses.6.transducer is missing; responses.6.axis is missing"),
    ],
)
def test_a_sensor_that_does_not_fit_is_named(tmp_path, change, said):
    shutil.copy(shipped_specimens()["front_axle"].with_suffix(".sdf"), tmp_path)
    document = read_document(shipped_specimens()["front_axle"])
    document["responses"].append({"name": "extra", "range": 1.0, "noise_rms": 0.0, "label": "extra"} | change)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(SpecimenError) as caught:
        load_rig(path)
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")


def test_sensors_are_of_the_kinds_their_keys_say(model):
    kinds = {sensor.name: type(sensor) for sensor in model.assembly.transducers}
    assert kinds["left_moment_x"] is SpindleMoment
    assert kinds["left_knuckle_lateral_acceleration"] is Accelerometer
    assert kinds["left_lower_rear_lateral"] is BushingForce
