"""The aerospace rig: its modes, what it plays against its analytic FRF, its noise, what is refused."""

import copy

import numpy as np
import pytest
import yaml

import rig_sim.structure.rig
from duralab_bus import FaultError
from duralab_gateway.description import check_drive
from rig_sim.bus import describe_rig
from rig_sim.loading import load_any_rig
from rig_sim.specimen.specimen import SpecimenError, shipped_specimens
from rig_sim.structure import modal_model

PATH = shipped_specimens()["aerospace"]


@pytest.fixture(scope="module")
def aerospace():
    return load_any_rig(PATH)


def document():
    return yaml.safe_load(PATH.read_text())


def written(folder, content):
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def quiet(folder):
    content = document()
    for response in content["responses"]:
        response["noise_rms"] = 0.0
    return load_any_rig(written(folder, content))


def played(rig, drive, seed=1):
    playback = rig.playback(drive, seed=seed)
    blocks = list(playback.blocks())
    return playback, blocks


def test_it_has_ten_elastic_modes_between_3_and_80_hz_two_of_them_close_and_all_lightly_damped(aerospace):
    modes = aerospace.modes
    elastic = (modes.frequency > 3.0) & (modes.frequency < 80.0)
    assert np.count_nonzero(elastic) == 10
    frequency, damping = modes.frequency[elastic], modes.damping[elastic]
    assert damping.min() == 0.002
    assert damping.max() <= 0.01
    closest = np.min(np.diff(frequency) / frequency[:-1])
    assert 0.005 < closest < 0.02
    # Six modes of the cords, at most half of the first elastic one.
    assert np.count_nonzero(~elastic & (modes.frequency < 3.0)) == 6
    assert modes.frequency[5] < frequency[0] / 2
    # What the laboratories measured at the test bed, which has a viscoelastic layer on its wing.
    measured = [6.4, 16.1, 33.1, 33.5, 35.7, 48.4, 49.4, 55.1, 63.0, 66.5]
    np.testing.assert_allclose(frequency, measured, rtol=0.17)


def test_it_has_the_mass_of_its_aluminium(aerospace):
    metal = 2700.0 * (1.5 * 0.05 * 0.15 + 0.1 * 0.01 * (2.0 + 2 * 0.4 + 0.38 + 0.4))
    _, mass, _ = modal_model._assemble(aerospace.specimen)
    along_x = np.zeros(len(mass))
    along_x[::6] = 1.0
    assert along_x @ mass @ along_x == pytest.approx(metal + 0.3, rel=1e-9)


def test_a_long_periodic_multisine_shows_the_analytic_sampled_frf(tmp_path):
    rig = quiet(tmp_path)
    # Four periods of 8 s with one drive each; the slowest decay is 0.77 Hz at 2 %, so wait until it is gone.
    period, rate = 4096, rig.specimen.sample_rate
    lines = np.arange(4, 82 * 8)
    rng = np.random.default_rng(3)
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    wave = np.fft.irfft(spectrum)
    wave /= np.abs(wave).max()
    analytic = rig.sampled_frf(lines * rate / period)
    slowest = float(np.min(rig.modes.damping * 2 * np.pi * rig.modes.frequency))
    periods = int(np.ceil(28.0 / slowest / (period / rate))) + 1
    for index in range(4):
        drive = np.zeros((4, periods * period))
        drive[index] = np.tile(wave, periods)
        response = played(rig, drive)[0].response
        answer = np.fft.rfft(response[:, -period:])[:, lines] / np.fft.rfft(wave)[lines]
        error = np.abs(answer.T - analytic[:, :, index]).max(axis=0) / np.abs(analytic[:, :, index]).max(axis=0)
        assert error.max() < 1e-10


def test_it_does_not_drift_and_rests_where_nothing_pushes(tmp_path):
    rig = quiet(tmp_path)
    assert np.all(played(rig, np.zeros((4, 3000)))[0].response == 0.0)
    np.testing.assert_array_equal(rig.static_response, np.zeros(6))
    # A constant force accelerates nothing for long, for it hangs on cords.
    pushed = played(rig, np.full((4, 512 * 240), 1.0))[0].response
    assert np.abs(pushed[:, -512:]).max() < 1e-6 * np.abs(pushed).max()


def test_noise_has_a_seed_and_its_rms(aerospace):
    still = np.zeros((4, 8000))
    first, again, other = (played(aerospace, still, seed)[0].response for seed in (5, 5, 6))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    np.testing.assert_allclose(first.std(axis=1), [c.noise_rms for c in aerospace.specimen.responses], rtol=0.05)


@pytest.mark.parametrize("samples", [1, 7, 5000])
def test_the_size_of_blocks_changes_no_bit(aerospace, monkeypatch, samples):
    drive = np.random.default_rng(0).uniform(-1, 1, (4, 1234))
    whole, blocks = played(aerospace, drive)
    np.testing.assert_array_equal(np.hstack([block.response for block in blocks]), whole.response)
    np.testing.assert_array_equal(np.hstack([block.drive for block in blocks]), drive)
    monkeypatch.setattr(rig_sim.structure.rig, "BLOCK_SAMPLES", samples)
    assert played(aerospace, drive)[0].response.tobytes() == whole.response.tobytes()


def test_the_ramp_down_goes_on_without_a_seam_and_ends_at_zero(tmp_path):
    rig = quiet(tmp_path)
    drive = np.random.default_rng(0).uniform(-1, 1, (4, 500))
    playback = rig.playback(drive, seed=1)
    blocks = playback.blocks()
    head = [next(blocks) for _ in range(3)]
    tail = list(playback.ramp_down())
    forces = np.hstack([block.drive for block in [*head, *tail]])
    assert [block.first_sample for block in tail][:2] == [300, 400]
    assert np.all(forces[:, -50:] == 0.0)
    np.testing.assert_array_equal(forces[:, 300], drive[:, 300])
    # The whole of it is what one playback of these forces gives.
    np.testing.assert_allclose(
        np.hstack([block.response for block in [*head, *tail]]), played(rig, forces)[0].response, atol=1e-12
    )
    assert [use.saturated_share for use in playback.uses()] == [0.0] * 4
    assert playback.uses()[0].peak_command_ratio == pytest.approx(np.abs(drive[0, :300]).max() / 20.0)


def test_a_force_beyond_the_shaker_is_refused(aerospace):
    description = describe_rig(aerospace)
    drive = np.zeros((4, 10))
    drive[2, 5] = 21.0
    with pytest.raises(FaultError, match="nose is 21 N"):
        check_drive(description, description.drives, 512.0, drive)


def test_what_it_answers_has_a_hash_of_its_own(tmp_path, aerospace):
    assert load_any_rig(PATH).content_hash == aerospace.content_hash
    assert quiet(tmp_path).content_hash != aerospace.content_hash


def put(content, path, value):
    inner = content = copy.deepcopy(content)
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return content


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["kind"], "modal", "kind is 'modal'; leave it out for a multibody rig, or say state_space or fmu."),
        (["beams", 0, "start"], "bow", "front_fuselage is at point 'bow'; the points are "),
        (["beams", 0, "section"], "tube", "front_fuselage has section 'tube'; the sections are fuselage, plate"),
        (["beams", 0, "width_axis"], [1, 0, 0], "front_fuselage has no length, or its width axis runs along it"),
        (["points", "spare"], [0, 0, 1], None),
        (["drives", 0, "name"], "nose", "two drives are called 'nose'"),
        (["responses", 0, "name"], "nose", "two responses are called 'nose'"),
        (["damping", "further"], 0.0, "damping.further is 0.0"),
        (["highest_mode"], 300.0, "highest_mode is 300 Hz; it must lie above"),
        (["bungees"], [{"point": "nose", "stiffness": [0, 0, 100]}], "the structure is not held in every direction"),
        (["drives", 0, "unit"], "m", "'left_wing' is a force, whose unit is not 'm'"),
        (["masses", 0, "mass"], -1.0, "masses.0.mass is -1.0"),
    ],
)
def test_a_bad_structure_is_refused_in_one_sentence(tmp_path, path, value, said):
    target = written(tmp_path, put(document(), path, value))
    if said is None:
        load_any_rig(target)
        return
    with pytest.raises(SpecimenError) as caught:
        load_any_rig(target)
    assert said in str(caught.value)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
