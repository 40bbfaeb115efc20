"""What ships for tests: a rig that answers as it says, repeats with the seed, keeps the contract; labs that end."""

import subprocess
import sys

import numpy as np
import psutil
import pytest

import duralab
from duralab.conformance import Outcome, check_rig
from duralab.errors import InputError, LabError
from duralab.testing import FOREIGN_RIG, LinearRig, check_contract, foreign_gateway, lab
from duralab_bus import BusConfig, open_bus
from duralab_gateway import Run
from duralab_proto.v1 import array_pb2

FREQUENCY = np.linspace(0.0, 450.0, 46)


def drive(samples=5000, seed=1):
    return 1.0e-3 * np.random.default_rng(seed).standard_normal((2, samples))


def play(rig, given, *, pieces, seed=7):
    run = Run("a", seed=seed)
    return np.hstack([rig.play(piece, run) for piece in np.array_split(given, pieces, axis=1)])


@pytest.mark.parametrize("pieces", [1, 7, 50])
def test_a_run_is_the_same_however_it_is_cut_and_as_it_was_foretold(pieces):
    rig, given = LinearRig(static=(10.0, -3.0), noise_rms=(2.0, 0.5)), drive()
    np.testing.assert_allclose(play(rig, given, pieces=pieces), rig.respond(given, seed=7), rtol=0, atol=1e-9)


def test_the_noise_repeats_with_the_seed_and_only_with_it():
    rig, still = LinearRig(noise_rms=(2.0, 0.5)), np.zeros((2, 20_000))
    first, again, other = (play(rig, still, pieces=3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(np.std(first, axis=1), [2.0, 0.5], rtol=0.03)
    assert abs(np.corrcoef(first[0], other[0])[0, 1]) < 0.03
    assert abs(np.corrcoef(first)[0, 1]) < 0.03


def test_the_frf_is_that_of_what_it_plays():
    """The impulse response, long after it has died out, transformed by hand."""
    rig, taps = LinearRig(), 4000
    frf = rig.sampled_frf(FREQUENCY)
    delays = np.exp(-2j * np.pi * np.outer(FREQUENCY / 1000.0, np.arange(taps)))
    for column in range(2):
        impulse = np.zeros((2, taps))
        impulse[column, 0] = 1.0
        np.testing.assert_allclose(frf[:, :, column], delays @ rig.respond(impulse).T, rtol=1e-9)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (
            {"plant": [[([1.0], [1.0])], []]},
            "plant has rows of [0, 1] filters; each response needs one for every drive.",
        ),
        (
            {"drives": [array_pb2.Channel(name="a")]},
            "2 responses to 2 drives; 2 response and 1 drive channels are given.",
        ),
        ({"static": [1.0]}, "static has the shape (1,); it must be (2,)."),
    ],
)
def test_what_does_not_fit_together_is_refused(settings, said):
    with pytest.raises(ValueError, match=r"must be|are given|each response") as caught:
        LinearRig(**settings)
    assert said in str(caught.value)


def test_the_rig_keeps_the_contract():
    findings = check_contract(LinearRig(noise_rms=1.0))
    assert [finding for finding in findings if finding.outcome is Outcome.FAILED] == []
    not_tried = {finding.check for finding in findings if finding.outcome is Outcome.NOT_TRIED}
    # It has no slew limit and no bodies.
    assert not_tried == {"refuse.jump", "play.poses"}


def test_strain_angle_voltage_and_current_are_kinds_of_the_contract():
    kinds = {"STRAIN": "1", "ANGLE": "rad", "VOLTAGE": "V", "CURRENT": "A"}
    responses = [
        array_pb2.Channel(
            name=kind.lower(), unit=unit, kind=getattr(array_pb2, f"CHANNEL_KIND_{kind}"), minimum=-9.0, maximum=9.0
        )
        for kind, unit in kinds.items()
    ]
    plant = [[([1.0], [1.0]), ([1.0], [1.0])] for _ in kinds]
    findings = check_contract(LinearRig(plant=plant, responses=responses))
    assert [finding for finding in findings if finding.outcome is Outcome.FAILED] == []
    responses[0].unit = "N"
    (found,) = [f for f in check_contract(LinearRig(plant=plant, responses=responses)) if f.outcome is Outcome.FAILED]
    assert "'strain' is in 'N'; its kind is in '1'" in found.sentence


def test_a_rig_that_breaks_the_contract_is_found():
    rig = LinearRig()
    rig.play = lambda commands, _run: np.zeros((2, commands.shape[1] + 1))
    findings = {finding.check: finding for finding in check_contract(rig)}
    assert findings["play"].outcome is Outcome.FAILED
    assert "measured an array of shape" in findings["play"].sentence


def test_a_lab_plays_rigs_of_this_process_and_of_a_stranger_and_leaves_no_process(tmp_path):
    rig, given = LinearRig(noise_rms=1.0), drive()
    with lab(rig, out=tmp_path) as started:
        assert isinstance(started, duralab.Lab)
        played = started.play("linear", given, seed=5)
        np.testing.assert_allclose(played.response.samples, rig.respond(given, seed=5), rtol=0, atol=1e-9)
        with foreign_gateway(started.endpoints[0]) as process:
            started._bus.wait_for_live({("rig_sim", FOREIGN_RIG)}, 30.0)
            assert started.describe(FOREIGN_RIG).engine == "somebody's own"
        children = [child for child in psutil.Process().children(recursive=True) if "--config" in child.cmdline()]
        assert len(children) == 3
    assert not psutil.pid_exists(process)
    assert psutil.wait_procs(children, 10.0)[1] == []


def test_a_lab_without_a_rig_and_a_gateway_without_a_lab_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"the lab has no rig; give it one or more, such as LinearRig\(\)\."):
        lab(out=tmp_path).__enter__()
    with pytest.raises(LabError, match=r"did not join the lab at tcp/127\.0\.0\.1:9; is a lab there"):
        foreign_gateway("tcp/127.0.0.1:9").__enter__()


def test_the_fixtures_give_all_tests_of_a_session_one_lab(tmp_path):
    (tmp_path / "conftest.py").write_text("from duralab.testing.fixtures import linear_lab, linear_rig  # noqa: F401\n")
    (tmp_path / "test_it.py").write_text(
        "import numpy as np\n"
        "def test_one(linear_lab, linear_rig):\n"
        "    drive = np.zeros((2, 200))\n"
        "    played = linear_lab.play('linear', drive, seed=5)\n"
        "    np.testing.assert_allclose(played.response.samples, linear_rig.respond(drive, seed=5))\n"
        "def test_two(linear_lab):\n"
        "    assert 'linear' in linear_lab.rig_names()\n"
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=170, cwd=tmp_path)
    assert "2 passed" in run.stdout, run.stdout + run.stderr


def test_the_foreign_gateway_keeps_the_contract():
    with open_bus(BusConfig(), service="duralab") as bus, foreign_gateway(bus.listening[0]):
        bus.wait_for_live({("rig_sim", FOREIGN_RIG)}, 30.0)
        findings = check_rig(bus, FOREIGN_RIG, seconds=1.0)
    assert [finding for finding in findings if finding.outcome is Outcome.FAILED] == []
    assert sum(finding.outcome is Outcome.PASSED for finding in findings) == len(findings) - 2
