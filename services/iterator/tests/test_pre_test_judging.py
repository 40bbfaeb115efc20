"""The judgement of a pre-test: each fault seeded on a linear plant is found with its channel, and no healthy one."""

import numpy as np
import pytest

from duralab.testing import LinearRig
from duralab_gateway import Run
from iterator.limits import DriveLimits
from iterator.pre_test.expectation import Expectation, KnownFrf, expected_of_model, in_windows, smoothed, within
from iterator.pre_test.judging import Check, Drive, ResponseChannel, judge
from iterator.pre_test.matching import match_channels
from iterator.pre_test.pulses import LARGEST_LEVEL, pulse_train

RATE = 500.0
RANGE = 1000.0


def lowpass(gain, pole=0.9):
    return [gain * (1.0 - pole)], [1.0, -pole]


#: Three drives of 0.1 m and three responses in N: each moves its own most, and the others by other shares.
PLANT = [
    [lowpass(5e4), lowpass(8e3, 0.8), lowpass(-4e3)],
    [lowpass(-3e3, 0.85), lowpass(4e4, 0.92), lowpass(6e3)],
    [lowpass(9e3), lowpass(2e3, 0.7), lowpass(-6e4, 0.88)],
]
NAMES = ("first", "second", "third")
LIMITS = DriveLimits(
    tuple(f"{name}_stroke" for name in NAMES),
    ("m",) * 3,
    np.full(3, -0.1),
    np.array([0.1, 0.1, 0.08]),
    np.array([2.0, 1.0, 0.0]),
    RATE,
)
TRAIN = pulse_train(LIMITS, sample_rate=RATE, level=LARGEST_LEVEL)
STATIC = np.array([100.0, -20.0, 0.0])
NOISE = 0.5


def rig(plant=PLANT, noise=NOISE):
    return LinearRig(plant=plant, sample_rate=RATE, static=STATIC, noise_rms=noise)


def measured(seed=1, *, plant=PLANT, drive=None, noise=NOISE):
    return rig(plant, noise).play(TRAIN.drive if drive is None else drive, Run("a", seed=seed))


def responses(polarity=(0, 0, 0), named=("", "", "")):
    return [
        ResponseChannel(name, "N", -RANGE, RANGE, static, sign, drive)
        for name, static, sign, drive in zip(NAMES, STATIC, polarity, named, strict=True)
    ]


def judged(response, *, expected=None, drives=None, **table):
    drives = [Drive(name) for name in LIMITS.names] if drives is None else drives
    return judge(TRAIN, response, drives=drives, responses=responses(**table), sample_rate=RATE, expected=expected)


def earlier(seed=99, plant=PLANT):
    response = measured(seed, plant=plant)
    moved = response - response[:, : TRAIN.rest].mean(axis=1)[:, None]
    return Expectation(within(None, in_windows(moved, TRAIN), RATE))


def modelled():
    frequency = np.arange(0.0, RATE / 2.0 + 0.1, RATE / 1024)
    return expected_of_model(KnownFrf(frequency, rig().sampled_frf(frequency), (0.5, 60.0)), TRAIN, RATE)


TABLE = {"polarity": (1, 1, -1), "named": LIMITS.names}
KNOWLEDGE = {
    "nothing": lambda: {},
    "sensor table": lambda: TABLE,
    "model": lambda: {"expected": modelled()},
    "earlier pre-test": lambda: {"expected": earlier()},
    "all": lambda: {"expected": modelled(), **TABLE},
}


def found(judgement):
    return {(finding.check, finding.channels) for finding in judgement.findings if finding.failed}


def test_pulses_stay_within_the_level_of_limits_and_slew_limits_and_come_one_by_one():
    for level in (0.01, LARGEST_LEVEL):
        train = pulse_train(LIMITS, sample_rate=RATE, level=level)
        peaks = np.abs(train.drive).max(axis=1)
        # The third may go further down than up, and has no slew limit.
        np.testing.assert_allclose(peaks[[0, 2]], [level * 0.1, level * 0.1])
        assert train.amplitude[2] < 0.0
        slew = np.abs(np.diff(train.drive, axis=1)).max(axis=1) * RATE
        assert slew[0] <= 1.0000001 * level * 2.0
        assert slew[1] <= 1.0000001 * level * 1.0
        assert ((train.drive != 0.0).sum(axis=0) <= 1).all()
        assert not train.drive[:, : train.rest].any()
        for row, window in enumerate(train.windows):
            assert (np.flatnonzero(train.drive[row]) >= window.start).all()
            assert (np.flatnonzero(train.drive[row]) < window.stop).all()


@pytest.mark.parametrize("knowledge", KNOWLEDGE)
def test_a_healthy_rig_passes_with_any_knowledge_and_noise(knowledge):
    known = KNOWLEDGE[knowledge]()
    for seed in range(20):
        judgement = judged(measured(seed), **known)
        assert judgement.findings == ()
        assert judgement.passed
    np.testing.assert_allclose(judgement.noise, NOISE, rtol=0.1)
    np.testing.assert_allclose(judgement.offset, 0.0, atol=0.1)
    if "expected" in known:
        np.testing.assert_allclose(judgement.lag, 0.0, atol=1e-3)
        np.testing.assert_allclose(judgement.gain, 1.0, rtol=0.02)
    # The peak of each pair is that of the plant without noise, under the window of the smoothing.
    still = smoothed(measured(plant=PLANT, noise=0.0) - STATIC[:, None], RATE)
    peaks = np.abs(in_windows(still, TRAIN)).max(axis=2)
    np.testing.assert_allclose(judgement.peak, peaks, atol=4.0 * NOISE)


def dead_response(response):
    response[1] = STATIC[1] + NOISE * np.random.default_rng(3).standard_normal(response.shape[1])


def unplugged_response(response):
    response[1] = 0.0


def noisy(response):
    response[2] += 0.02 * RANGE * np.random.default_rng(4).standard_normal(response.shape[1])


def shifted(response):
    response[0] += 0.03 * RANGE


def at_its_end(response):
    response[0] = np.minimum(response[0] + 0.96 * RANGE, RANGE)


def clipped(response):
    response[0] = np.clip(response[0], STATIC[0] - 60.0, STATIC[0] + 60.0)


ANYHOW = {
    dead_response: {(Check.DEAD, ("second",))},
    unplugged_response: {(Check.DEAD, ("second",))},
    noisy: {(Check.NOISE, ("third",))},
    shifted: {(Check.OFFSET, ("first",))},
    at_its_end: {(Check.SATURATION, ("first",)), (Check.OFFSET, ("first",))},
    clipped: {(Check.SATURATION, ("first",))},
}


@pytest.mark.parametrize("knowledge", KNOWLEDGE)
@pytest.mark.parametrize("fault", ANYHOW)
def test_a_fault_of_one_response_is_found_without_an_expectation_too(fault, knowledge):
    for seed in range(5):
        response = measured(seed)
        fault(response)
        assert found(judged(response, **KNOWLEDGE[knowledge]())) == ANYHOW[fault]


@pytest.mark.parametrize("knowledge", KNOWLEDGE)
def test_a_dead_drive_is_found(knowledge):
    drive = TRAIN.drive.copy()
    drive[1] = 0.0
    judgement = judged(measured(drive=drive), **KNOWLEDGE[knowledge]())
    assert (Check.DEAD, ("second_stroke",)) in found(judgement)
    assert {check for check, _ in found(judgement)} <= {Check.DEAD, Check.SWAPPED}


def test_a_road_input_that_does_nothing_at_rest_is_not_dead():
    drive = TRAIN.drive.copy()
    drive[1] = 0.0
    drives = [Drive(name, moves_alone=name != "second_stroke") for name in LIMITS.names]
    assert judged(measured(drive=drive), drives=drives).passed
    # An expectation that says otherwise counts.
    assert not judged(measured(drive=drive), drives=drives, expected=modelled()).passed


def inverted(order, row):
    changed = order.copy()
    changed[row] *= -1
    return changed


EXPECTING = [name for name in KNOWLEDGE if name not in ("nothing", "sensor table")]


@pytest.mark.parametrize("knowledge", ["sensor table", *EXPECTING])
@pytest.mark.parametrize("row", range(3))
def test_an_inverted_response_is_found(row, knowledge):
    response = measured()
    response[row] = 2.0 * STATIC[row] - response[row]
    assert found(judged(response, **KNOWLEDGE[knowledge]())) == {(Check.POLARITY, (NAMES[row],))}


@pytest.mark.parametrize("knowledge", EXPECTING)
@pytest.mark.parametrize("row", range(3))
def test_an_inverted_drive_is_told_from_an_inverted_response(row, knowledge):
    judgement = judged(measured(drive=inverted(TRAIN.drive, row)), **KNOWLEDGE[knowledge]())
    assert (Check.POLARITY, (LIMITS.names[row],)) in found(judgement)
    (sentence,) = [f.sentence for f in judgement.findings if f.channels == (LIMITS.names[row],)]
    assert sentence.startswith(f"The drive {LIMITS.names[row]} is inverted; look at the cables")


@pytest.mark.parametrize("knowledge", EXPECTING)
@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_swapped_channels_are_found_and_drives_told_from_responses(pair, knowledge):
    order = np.arange(3)
    order[list(pair)] = order[list(pair[::-1])]
    known = KNOWLEDGE[knowledge]()
    rest = STATIC[:, None]
    swapped = judged((measured() - rest)[order] + rest, **known)
    assert (Check.SWAPPED, tuple(NAMES[one] for one in pair)) in found(swapped)
    assert {check for check, _ in found(swapped)} == {Check.SWAPPED}
    drives = judged(measured(drive=TRAIN.drive[order]), **known)
    assert (Check.SWAPPED, tuple(LIMITS.names[one] for one in pair)) in found(drives)


def test_the_sensor_table_alone_finds_swapped_responses():
    order = [1, 0, 2]
    rest = STATIC[:, None]
    judgement = judged((measured() - rest)[order] + rest, **TABLE)
    assert found(judgement) == {(Check.SWAPPED, ("first",)), (Check.SWAPPED, ("second",))}
    assert "first is moved by second_stroke and hardly by first_stroke, which the sensor table names" in str(judgement)


def test_without_knowledge_an_inverted_or_swapped_response_passes():
    """Then nothing says what is right; the caller says that the check is missing."""
    response = measured()
    response[0] = 2.0 * STATIC[0] - response[0]
    assert judged(response).passed


def test_where_drive_and_response_cannot_be_told_apart_both_are_named():
    plant = [[lowpass(5e4) if row == column else ([0.0], [1.0]) for column in range(3)] for row in range(3)]
    response = measured(plant=plant)
    response[0] = 2.0 * STATIC[0] - response[0]
    (finding,) = judged(response, expected=earlier(plant=plant)).findings
    assert finding.channels == ("first", "first_stroke")
    assert finding.sentence.startswith("The response first is inverted or the drive first_stroke is inverted;")


@pytest.mark.parametrize("samples", [-9, 8, 20])
def test_a_lag_is_measured_to_a_part_of_a_sample_and_found_from_5_ms_on(samples):
    response = measured()
    response[1] = np.roll(response[1], samples)
    judgement = judged(response, expected=modelled())
    assert judgement.lag[1] == pytest.approx(samples / RATE, abs=5e-4)
    assert found(judgement) == ({(Check.LAG, ("second",))} if abs(samples) / RATE > 0.006 else set())


@pytest.mark.parametrize(("factor", "passed"), [(3.0, True), (0.3, True), (0.15, False), (1e-3, False)])
def test_a_gain_is_a_remark_up_to_a_factor_that_only_a_wrong_unit_has(factor, passed):
    response = measured(noise=1e-3)
    response[0] = STATIC[0] + factor * (response[0] - STATIC[0])
    judgement = judged(response, expected=modelled())
    assert judgement.passed is passed
    assert [(finding.check, finding.channels) for finding in judgement.findings] == [(Check.GAIN, ("first",))]
    assert judgement.gain[0] == pytest.approx(factor, rel=0.02)


def test_a_response_that_is_like_nothing_expected_is_a_remark_and_no_inversion():
    response = measured(noise=0.01)
    own = response[0] - STATIC[0]
    other = np.gradient(own)
    # A signal and its derivative are orthogonal: the correlation is -0.4.
    size = np.linalg.norm(own) / np.linalg.norm(other)
    response[0] = STATIC[0] - 0.4 * own + np.sqrt(1.0 - 0.4**2) * size * other
    judgement = judged(response, expected=earlier())
    assert judgement.passed
    assert [(finding.check, finding.channels) for finding in judgement.findings] == [(Check.CROSS_TALK, ("first",))]


def test_an_actuator_at_its_limit_is_found():
    drives = [Drive(name, saturated_share=0.25 * (name == "third_stroke")) for name in LIMITS.names]
    assert found(judged(measured(), drives=drives)) == {(Check.SATURATION, ("third_stroke",))}


def test_the_model_is_compared_in_its_band_only():
    expected = modelled()
    response = in_windows(measured(noise=0.0) - STATIC[:, None], TRAIN)
    filtered = within(expected.band, response, RATE)
    np.testing.assert_allclose(filtered, expected.response, atol=1e-3 * np.abs(response).max())
    assert expected_of_model(KnownFrf(np.arange(3.0), np.ones((3, 3, 3)), (0.5, 1.5)), TRAIN, RATE) is None


def test_two_faults_at_once_are_both_found():
    response = measured()
    response[0], response[2] = (
        STATIC[0] + (response[2] - STATIC[2]),
        STATIC[2] + (response[0] - STATIC[0]),
    )
    response[1] = 2.0 * STATIC[1] - response[1]
    assert found(judged(response, expected=modelled())) == {
        (Check.SWAPPED, ("first", "third")),
        (Check.POLARITY, ("second",)),
    }


def test_a_record_without_motion_matches_nothing_and_changes_nothing():
    wanted = earlier().response
    match = match_channels(np.zeros_like(wanted), wanted, amplitude=TRAIN.amplitude, floor=np.ones(3))
    assert match.changes == ()
    assert np.isnan(match.likeness).all()
