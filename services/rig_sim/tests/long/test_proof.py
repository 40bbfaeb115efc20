"""The proof at load: compiled against numpy, both against Drake, and a rig that differs does not play."""

import dataclasses
import json

import numpy as np
import pytest
from served_rig import RIG, Client, wave

import duralab_bus
from duralab_gateway import SERVICE
from duralab_proto.v1 import rig_pb2
from rig_sim import load_any_rig
from rig_sim.checks.proof import ProofError, drake_answers, prove, random_state
from rig_sim.compile import FOLDER_VARIABLE
from rig_sim.compile.model import compile_model
from rig_sim.model.assembly import assemble
from rig_sim.model.rig_model import RigModel
from rig_sim.multibody.drake_reader import load_plant, read_tree
from rig_sim.service import RigSimConfig, serve
from rig_sim.specimen.specimen import shipped_specimens


def compiled(model):
    return compile_model(
        model.traced, state_names=model.state_names, input_names=model.input_names, output_names=model.output_names
    )


@pytest.fixture(scope="module")
def plant(rig):
    return load_plant(shipped_specimens()[rig.specimen.name].with_name(rig.specimen.sdf))


def test_the_shipped_rigs_agree_with_drake_to_rounding(rig):
    proof = rig.proof
    assert proof.states >= 20
    assert proof.acceleration_error < 1e-11
    assert proof.force_error < 1e-11
    assert proof.position_rate_error < 1e-14
    assert proof.element_rate_error < 1e-12


def test_drake_and_plain_numpy_agree_without_the_compiler(rig, plant):
    rng = np.random.default_rng(11)
    model = rig.model
    n_q, n_v = model.position_count, model.assembly.tree.velocity_count
    for _ in range(5):
        state = random_state(model, rng)
        inputs = 0.02 * rng.standard_normal(len(model.input_names))
        evaluation = model.evaluate(state, inputs)
        drake = drake_answers(model, plant, state, inputs, evaluation)
        rates = np.array(evaluation.derivative, dtype=float)
        scale = np.abs(drake.accelerations).max()
        np.testing.assert_allclose(rates[:n_q], drake.position_rates, rtol=0, atol=1e-14)
        np.testing.assert_allclose(rates[n_q : n_q + n_v], drake.accelerations, rtol=0, atol=1e-11 * scale)
        forces = np.array(evaluation.responses, dtype=float)
        np.testing.assert_allclose(forces, drake.responses, rtol=0, atol=1e-11 * np.abs(forces).max())


def test_compiled_code_and_plain_numpy_agree(rig):
    rng = np.random.default_rng(12)
    for _ in range(10):
        state = random_state(rig.model, rng)
        inputs = 0.02 * rng.standard_normal(len(rig.model.input_names))
        derivative, outputs = (np.array(values, dtype=float) for values in rig.model.traced(state, inputs))
        for own, plain in (
            (rig.compiled.derivative(state, inputs), derivative),
            (rig.compiled.outputs(state, inputs), outputs),
        ):
            np.testing.assert_allclose(own, plain, rtol=1e-12, atol=1e-12 * np.abs(plain).max())


def tampered(tree, what):
    if what == "bushing":
        first = dataclasses.replace(tree.bushings[0], force_stiffness=tree.bushings[0].force_stiffness * 1.001)
        return dataclasses.replace(tree, bushings=(first, *tree.bushings[1:]))
    if what == "spring":
        first = dataclasses.replace(tree.springs[0], damping=tree.springs[0].damping * 1.001)
        return dataclasses.replace(tree, springs=(first, *tree.springs[1:]))
    if what == "gravity":
        return dataclasses.replace(tree, gravity=tree.gravity * 1.001)
    index = tree.body_index("left_wheel")
    wheel = tree.bodies[index]
    if what == "mass":
        wheel = dataclasses.replace(wheel, mass=wheel.mass * 1.001)
    else:
        wheel = dataclasses.replace(wheel, inertia=wheel.inertia * 1.001)
    return dataclasses.replace(tree, bodies=(*tree.bodies[:index], wheel, *tree.bodies[index + 1 :]))


@pytest.mark.parametrize("what", ["bushing", "spring", "gravity", "mass", "inertia"])
def test_a_player_of_another_specimen_than_drakes_does_not_start(front_axle, what):
    specimen = front_axle.specimen
    plant = load_plant(shipped_specimens()["front_axle"].with_name(specimen.sdf))
    model = RigModel(assemble(specimen, tampered(read_tree(plant), what)))
    with pytest.raises(ProofError) as caught:
        prove(model, compiled(model), plant)
    message = str(caught.value)
    names = [*model.state_names, *model.response_names]
    assert any(repr(name) in message for name in names)
    assert "1e-09 of the largest value is allowed, so this rig must not play." in message


def test_a_transducer_that_reads_another_axis_does_not_start(front_axle):
    plant = load_plant(shipped_specimens()["front_axle"].with_name(front_axle.specimen.sdf))
    assembly = front_axle.model.assembly
    first = dataclasses.replace(assembly.transducers[0], row=0)
    model = RigModel(dataclasses.replace(assembly, transducers=(first, *assembly.transducers[1:])))
    with pytest.raises(ProofError, match="'left_vertical'"):
        prove(model, compiled(model), plant)


def test_compiled_code_that_differs_in_the_hydraulics_does_not_start(front_axle):
    # Drake knows nothing of oil: here plain numpy is the judge.
    plant = load_plant(shipped_specimens()["front_axle"].with_name(front_axle.specimen.sdf))
    kinds = dict(front_axle.specimen.actuator_kinds)
    kinds["vertical"] = kinds["vertical"].model_copy(
        update={"valve": dataclasses.replace(kinds["vertical"].valve, spool_damping=0.81)}
    )
    other = RigModel(
        assemble(front_axle.specimen.model_copy(update={"actuator_kinds": kinds}), front_axle.model.assembly.tree)
    )
    with pytest.raises(ProofError, match=r"plain numpy at 'left_vertical state 1'|plain numpy at 'right_vertical"):
        prove(front_axle.model, compiled(other), plant)


def kept_files(names, folder):
    """Load rigs and return their files of code in order, of each its model and the poses of its bodies."""
    files = []
    for name in names:
        before = set(folder.iterdir()) if folder.exists() else set()
        load_any_rig(shipped_specimens()[name])
        own = [
            file
            for file in set(folder.iterdir()) - before
            if "input_names" in head(file) and "entries" not in head(file)
        ]
        files += sorted(own, key=lambda file: head(file)["input_names"] == [])
    return files


def head(file):
    """Return what a file says of its code; that of a structure names the entries of its table of constants."""
    with file.open("rb") as stream:
        return json.loads(stream.readline())


def test_kept_poses_of_another_rig_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "code"))
    names = ("front_axle", "predecessor")
    poses = kept_files(names, tmp_path / "code")[1::2]
    poses[0].write_bytes(poses[1].read_bytes())
    with pytest.raises(ValueError, match="poses of the bodies disagree"):
        load_any_rig(shipped_specimens()[names[0]])


@pytest.fixture
def exchanged(tmp_path, monkeypatch):
    """The folder of kept code holds two rigs with the same names of states; their files are exchanged."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "code"))
    names = ("front_axle", "front_axle_compliant")
    files = kept_files(names, tmp_path / "code")[::2]
    contents = [file.read_bytes() for file in files]
    for file, content in zip(files, reversed(contents), strict=True):
        file.write_bytes(content)
    return names


def test_kept_code_of_another_rig_does_not_play(exchanged):
    for name in exchanged:
        with pytest.raises(ProofError, match="must not play"):
            load_any_rig(shipped_specimens()[name])


@pytest.mark.usefixtures("exchanged")
def test_a_rig_that_is_proven_late_describes_itself_and_never_moves():
    rig = load_any_rig(shipped_specimens()[RIG], prove_later=True)
    for _ in range(2):
        with pytest.raises(ProofError, match="must not play"):
            rig.playback(wave(1.0), seed=1)
    with duralab_bus.open_bus(service=SERVICE) as bus, serve(bus, RigSimConfig(rigs=(RIG,))):
        client = Client(bus)
        assert client.told.rig == RIG
        # The run waits for the proof, if that is not done yet.
        assert "must not play" in client.fault("a", wave(1.0)).message
        assert client.state().mode == rig_pb2.RIG_MODE_INTERLOCKED
        assert "the player disagrees with Drake at" in client.state().reason
        with pytest.raises(duralab_bus.FaultError, match=f"{RIG} cannot be reset: the player disagrees with Drake"):
            client.reset()
        assert not client.blocks


def test_code_of_a_structure_with_other_constants_does_not_play(tmp_path, monkeypatch):
    """The shared code of a structure exchanges two constants of the model."""
    folder = tmp_path / "code"
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    own, _ = kept_files(["front_axle"], folder)
    (structure,) = (file for file in folder.iterdir() if "entries" in head(file) and head(file)["input_names"])
    own.unlink()
    described = head(structure)
    entries = described["entries"]
    places = [place for place, entry in enumerate(entries) if isinstance(entry, int)]
    entries[places[0]], entries[places[-1]] = entries[places[-1]], entries[places[0]]
    code = structure.read_bytes().partition(b"\n")[2]
    structure.write_bytes(json.dumps(described).encode() + b"\n" + code)
    with pytest.raises(ProofError, match="must not play"):
        load_any_rig(shipped_specimens()["front_axle"])
