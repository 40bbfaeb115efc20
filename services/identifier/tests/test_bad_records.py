import numpy as np
import pytest
from known_plants import error, lightly_damped, noise_layout, periodic_experiment, respond

from duralab_settings import EstimatorKind
from identifier import Estimation, EstimatorOptions, WarningCode, estimate
from identifier.estimators.periodicity import SMALLEST_DECAY, PeriodicityCheck
from identifier.estimators.record_checks import ChannelCheck

SAMPLES = 40_000
LAYOUT = noise_layout(SAMPLES)


@pytest.fixture
def records():
    generator = np.random.default_rng(4)
    drive = generator.standard_normal((2, SAMPLES))
    return drive, respond(drive) + 0.01 * generator.standard_normal((3, SAMPLES))


def test_a_sound_record_has_no_warning(records):
    for kind in EstimatorKind:
        if kind is not EstimatorKind.H2:
            assert estimate(kind, *records, LAYOUT).warnings == ()


def test_a_clipped_response_is_named_with_its_share(records):
    drive, response = records
    limit = 1.5 * np.std(response[1])
    clipped = response.copy()
    clipped[1] = np.clip(response[1], -limit, np.inf)
    warning, *others = estimate(EstimatorKind.H1, drive, clipped, LAYOUT).warnings
    assert not others
    assert (warning.code, warning.channel, warning.of_drive) == (WarningCode.CLIPPED, 1, False)
    share = np.mean(clipped[1] == -limit)
    assert 0.5 * share < warning.size <= share
    assert "Response 1 is clipped" in warning.sentence


@pytest.mark.parametrize("piece", [1, 2, 5, 64, 1000])
def test_flat_tops_are_found_however_the_record_is_cut(piece):
    generator = np.random.default_rng(8)
    drive = np.clip(generator.standard_normal((1, 3000)).cumsum(axis=1) % 7.0, 0.5, 3.0)
    layout = noise_layout(3000, block=256)
    running = Estimation(EstimatorKind.H1, layout, drives=1, responses=1, options=EstimatorOptions())
    response = generator.standard_normal((1, 3000))
    for start in range(0, 3000, piece):
        running.add(drive[:, start : start + piece], response[:, start : start + piece])
    expected = 0
    for extreme in (0.5, 3.0):
        runs = "".join("x" if value == extreme else " " for value in drive[0]).split()
        expected += sum(len(run) for run in runs if len(run) >= 3)
    (warning,) = running.estimate().warnings
    assert warning.of_drive
    assert warning.size == pytest.approx(expected / 3000, abs=1e-12)


@pytest.mark.parametrize("kind", [EstimatorKind.H1, EstimatorKind.LOCAL_RATIONAL])
@pytest.mark.parametrize(
    ("factor", "text"),
    [(1e-200, "drive 0 stays at "), (1e-59, None), (1e59, None), (1e200, "Drive 1 reaches .*e.200; at most 1e.60 can")],
)
def test_magnitudes_that_overflow_are_refused_and_the_rest_gives_finite_numbers(records, kind, factor, text):
    drive, response = (record * factor for record in records)
    if text is not None:
        with pytest.raises(ValueError, match=text):
            estimate(kind, drive, response, LAYOUT)
        return
    found, plain = estimate(kind, drive, response, LAYOUT), estimate(kind, *records, LAYOUT)
    np.testing.assert_allclose(found.frf, plain.frf, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.residual_psd, plain.residual_psd * factor**2, rtol=1e-6)


@pytest.mark.parametrize("glitch", [2e60, -2e60])
def test_one_sample_of_either_sign_that_overflows_is_refused(glitch):
    check = ChannelCheck(2, name="response", of_drive=False)
    check.add(np.full((2, 5), glitch / 2.1))
    with pytest.raises(ValueError, match=r"Response 1 reaches 2e\+60; at most 1e\+60"):
        check.add(np.array([[0.0, 1.0, -1.0], [0.0, glitch, 0.0]]))


def test_a_dead_channel_is_refused_by_name(records):
    drive, response = records
    dead = response.copy()
    dead[0], dead[2] = 4.5, 0.0
    with pytest.raises(ValueError, match=r"response 0 stays at 4.5, response 2 stays at 0; check their sensors"):
        estimate(EstimatorKind.H1, drive, dead, LAYOUT)


@pytest.mark.parametrize("kind", [EstimatorKind.H1, EstimatorKind.LOCAL_RATIONAL])
def test_an_all_zero_drive_is_refused(records, kind):
    drive, response = records
    with pytest.raises(ValueError, match=r"drive 1 stays at 0; excite every drive"):
        estimate(kind, drive * [[1.0], [0.0]], response, LAYOUT)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_with_channel_and_sample(records, value):
    drive, response = records
    spoilt = response.copy()
    spoilt[1, 777] = value
    with pytest.raises(ValueError, match=r"response holds .* in channel 1 at sample 777"):
        estimate(EstimatorKind.H1, drive, spoilt, LAYOUT)


@pytest.mark.parametrize("sample", [3, 950])
def test_what_is_not_finite_in_a_fade_is_refused_as_well(sample):
    random = np.random.default_rng(3)
    layout = noise_layout(1000, block=256, fade=100)
    drive, response = random.standard_normal((2, 1000)), random.standard_normal((1, 1000))
    drive[1, sample] = -np.inf
    with pytest.raises(ValueError, match=f"drive holds -inf in channel 1 at sample {sample}"):
        estimate(EstimatorKind.H1, drive, response, layout)


def test_a_record_that_does_not_fit_its_layout_is_refused(records):
    drive, response = records
    with pytest.raises(ValueError, match="40000 samples were played and 39999 measured"):
        estimate(EstimatorKind.H1, drive, response[:, 1:], LAYOUT)
    with pytest.raises(ValueError, match="The record has 39999 samples, its layout 40000"):
        estimate(EstimatorKind.H1, drive[:, 1:], response[:, 1:], LAYOUT)
    longer = (np.hstack([record, record[:, :1]]) for record in (drive, response))
    with pytest.raises(ValueError, match="The record has 40001 samples or more"):
        estimate(EstimatorKind.H1, *longer, LAYOUT)


def test_a_record_shorter_than_a_block_has_no_layout():
    with pytest.raises(ValueError, match="capture"):
        noise_layout(1000, block=1024)


@pytest.mark.parametrize("periods", [1, 2])
def test_a_transient_left_in_the_captures_is_named(periods):
    plant = lightly_damped(0.01)
    drive, layout = periodic_experiment(delay=1, periods=periods)
    generator = np.random.default_rng(3)
    response = respond(drive, plant)
    response += 1e-3 * np.std(response) * generator.standard_normal(response.shape)
    found = [w for w in estimate(EstimatorKind.H1, drive, response, layout).warnings if w.code is WarningCode.TRANSIENT]
    assert [(warning.channel, warning.of_drive) for warning in found] == [(0, False), (1, False)]
    # The pole pair decays by exp(-zeta omega T) over the delay block, here to a quarter and to a tenth.
    assert 0.02 < found[0].size < 0.5
    assert found[1].size < found[0].size


@pytest.mark.parametrize("periods", [1, 2])
@pytest.mark.parametrize("piece", [300, 1500])
def test_a_transient_is_the_same_however_the_record_is_cut(periods, piece):
    drive, layout = periodic_experiment(delay=1, periods=periods)
    response = respond(drive, lightly_damped(0.01))
    whole, cut = PeriodicityCheck(layout, responses=2), PeriodicityCheck(layout, responses=2)
    whole.add(response)
    for start in range(0, response.shape[1], piece):
        cut.add(response[:, start : start + piece])
    assert [warning.channel for warning in whole.warnings()] == [0, 1]
    assert cut.warnings() == whole.warnings()


@pytest.mark.parametrize(("decay", "named"), [(1.3 * SMALLEST_DECAY, True), (SMALLEST_DECAY / 1.3, False)])
def test_a_difference_counts_as_a_transient_from_a_known_decay_on(decay, named):
    """Power in the first quarter of a period over that in its last: an exponential's is known."""
    drive, layout = periodic_experiment(delay=1, periods=2, drives=1, experiments=1)
    time = np.arange(drive.shape[1]) / 1024
    response = drive + 3.0 * np.std(drive) * np.exp(-0.5 * np.log(decay) / 0.75 * time)
    check = PeriodicityCheck(layout, responses=1)
    check.add(response)
    assert bool(check.warnings()) == named


def test_what_is_left_of_an_exponential_transient_in_a_single_capture_is_told():
    drive, layout = periodic_experiment(delay=1, periods=1, drives=1, experiments=1)
    time = np.arange(2 * 1024) / 1024
    transient = 2.0 * np.std(drive) * np.exp(-np.log(10.0) * time)
    response = drive + transient
    check = PeriodicityCheck(layout, responses=1)
    check.add(response)
    (warning,) = check.warnings()
    # The difference of two periods is 0.9 of the transient, as long as it decays to a tenth in each.
    expected = 0.9 * np.sqrt(np.mean(transient[1024:] ** 2)) / np.std(response[0, 1024:])
    assert warning.size == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("periods", [1, 3])
def test_noise_alone_is_no_transient(periods):
    drive, layout = periodic_experiment(delay=4, periods=periods)
    generator = np.random.default_rng(3)
    response = respond(drive)
    response += 0.3 * np.std(response) * generator.standard_normal(response.shape)
    assert estimate(EstimatorKind.H1, drive, response, layout).warnings == ()


def test_no_more_captures_than_drives_is_said():
    alone, layout = periodic_experiment(drives=1, experiments=2)
    once = alone[:, : layout.samples // 2]
    drive = np.vstack([np.hstack([once, once]), np.hstack([once, -once])])
    result = estimate(EstimatorKind.H1, drive, respond(drive), layout)
    assert [warning.code for warning in result.warnings] == [WarningCode.FEW_AVERAGES]
    assert not np.any(result.residual_psd)
    assert np.max(error(result)) < 1e-12
