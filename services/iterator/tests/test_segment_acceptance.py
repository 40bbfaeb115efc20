import numpy as np
import pytest
from scipy.ndimage import convolve1d

from duralab_settings import UpdateKind
from duralab_spectra import line_frequencies
from iterator import (
    AcceptanceSettings,
    IterationHistory,
    Playback,
    UpdateSettings,
    accept_segments,
    control_band,
    rig_model,
    step_start,
)

RATE = 100.0
SAMPLES = 2001
SCALE = np.array([1.0])


def history_of(*errors):
    """Playbacks whose drive is constant and says which one it was; target zero plus a tone for the energy's scale."""
    target = np.sin(np.arange(SAMPLES) / 3.0)[None, :]
    history = IterationHistory(target=target)
    for number, error in enumerate(errors, start=1):
        history = history.after(Playback(drive=np.full((1, SAMPLES), float(number)), response=target - error))
    return history


def tone(level):
    return level * np.sin(np.arange(SAMPLES) / 2.0)[None, :]


def accept(history, settings=None, *, iteration_gain=()):
    return accept_segments(
        history,
        response_scale=SCALE,
        sample_rate=RATE,
        settings=settings or AcceptanceSettings(),
        iteration_gain=iteration_gain,
    )


def test_an_improvement_everywhere_is_taken_as_it_is():
    history = history_of(tone(0.5), tone(0.2))
    found = accept(history)
    np.testing.assert_array_equal(found.drive, history.playbacks[-1].drive)
    np.testing.assert_array_equal(found.response, history.playbacks[-1].response)
    assert np.all(found.step_gain == 1.0)
    assert not found.rolled_back.any()


def test_where_a_playback_is_worse_drive_and_error_go_back_and_the_step_is_halved():
    worse_late = tone(0.2)
    worse_late[:, SAMPLES // 2 :] *= 10.0
    history = history_of(tone(0.5), worse_late)
    found = accept(history)
    early, late = slice(0, 700), slice(1300, SAMPLES)
    assert np.all(found.drive[:, early] == 2.0)
    np.testing.assert_allclose(found.drive[:, late], 1.0)
    np.testing.assert_allclose((history.target - found.response)[:, late], tone(0.5)[:, late])
    np.testing.assert_allclose(found.step_gain[late], 0.5)
    assert np.all(found.step_gain[early] == 1.0)
    assert found.rolled_back[late].all()
    # No jump where the two meet: half a second of Hann.
    assert np.max(np.abs(np.diff(found.drive))) < 2.1 / (0.5 * RATE)


def test_the_step_shrinks_no_further_than_allowed_and_grows_back_the_slower_the_more_often_it_failed():
    bad = [tone(2.0)] * 6
    assert np.allclose(accept(history_of(tone(0.5), *bad)).step_gain, 0.1)
    for failures, smallest in ((1, 0.5), (2, 0.25), (6, 0.1)):
        grown = accept(history_of(tone(0.5), *bad[:failures], tone(0.4))).step_gain
        np.testing.assert_allclose(grown, smallest * 1.25 ** (0.5**failures))


def test_a_step_that_brings_next_to_nothing_is_kept_and_the_next_one_is_smaller():
    half = tone(0.5)
    half[:, : SAMPLES // 2] *= 0.5
    found = accept(history_of(tone(0.5), tone(2.0), half))
    early, late = slice(0, 700), slice(1300, SAMPLES)
    assert np.all(found.drive == 3.0)
    assert not found.rolled_back.any()
    np.testing.assert_allclose(found.step_gain[early], 0.5 * 1.25**0.5)
    np.testing.assert_allclose(found.step_gain[late], 0.5 * 0.9)
    stuck = [tone(0.5)] * 4
    np.testing.assert_allclose(accept(history_of(tone(0.5), tone(2.0), *stuck)).step_gain, 0.5 * 0.9**4)
    np.testing.assert_allclose(accept(history_of(tone(0.5), tone(2.0), *stuck * 5)).step_gain, 0.1)
    np.testing.assert_allclose(accept(history_of(tone(0.5), *stuck)).step_gain, 0.9**4)


def test_progress_is_not_asked_for_where_it_is_set_to_none():
    found = accept(history_of(tone(0.5), tone(2.0), *[tone(0.5)] * 2), AcceptanceSettings(least_progress=0.0))
    np.testing.assert_allclose(found.step_gain, 0.5 * 1.25 ** (0.5 * 2))


@pytest.mark.parametrize("gain", [1.0, 0.6, 0.1])
@pytest.mark.parametrize("share", [0.2, 0.35, 0.45, 1.0])
def test_a_halved_step_grows_only_where_it_brings_four_tenths_of_what_its_gain_promised(gain, share):
    # A linear rig with an exact model keeps 1 - q of its error, so half a step keeps 1 - q / 2.
    promised = 1.0 - (1.0 - 0.5 * gain) ** 2
    errors = (tone(0.5), tone(2.0), tone(0.5 * np.sqrt(1.0 - share * promised)))
    found = accept(history_of(*errors), iteration_gain=(gain, gain)).step_gain
    np.testing.assert_allclose(found, 0.5 * (0.9 if share < 0.4 else 1.25**0.5))


@pytest.mark.parametrize(("schedule", "grown"), [((1.0, 1.0, 0.3), 1.25**0.5), ((0.3, 0.3, 1.0), 0.9), ((), 0.9)])
def test_an_update_judges_each_step_by_the_gain_that_made_it(schedule, grown):
    # The last step brought half of what a gain of 0.3 promised it, far less than a gain of 1 did.
    brought = 0.5 * (1.0 - (1.0 - 0.5 * 0.3) ** 2)
    history = history_of(tone(0.5), tone(2.0), tone(0.5 * np.sqrt(1.0 - brought)))
    frequency = line_frequencies(64, RATE)
    model = rig_model(frequency, np.ones((frequency.size, 1, 1)), identified_band=(1.0, 45.0))
    settings = UpdateSettings(
        band=control_band(5.0, 30.0, sample_rate=RATE),
        iteration_gain=(1.0,),
        kind=UpdateKind.BASIC_TWR,
        accept_segments=True,
        gain_schedule=schedule,
    )
    np.testing.assert_allclose(step_start(history, model, settings).step_gain, 0.5 * grown)


def test_gains_of_another_number_of_steps_are_refused():
    with pytest.raises(ValueError, match="2 iteration gains for 1 steps"):
        accept(history_of(tone(0.5), tone(0.4)), iteration_gain=(1.0, 1.0))


def test_the_energy_of_the_accepted_error_never_grows_beyond_the_tolerance():
    rng = np.random.default_rng(3)
    errors = [rng.uniform(0.1, 1.0) * rng.standard_normal((1, SAMPLES)) for _ in range(12)]
    best = np.inf
    for count in range(1, len(errors) + 1):
        history = history_of(*errors[:count])
        energy = float(np.mean((history.target - accept(history).response) ** 2))
        assert energy <= 1.1 * best
        best = min(best, energy)


def test_a_watched_channel_that_gets_worse_changes_nothing():
    target = np.vstack([np.ones(SAMPLES), np.zeros(SAMPLES)])
    history = IterationHistory(target=target)
    for number, (error, watched) in enumerate(((0.5, 0.0), (0.2, 100.0)), start=1):
        response = target - np.vstack([tone(error)[0], np.full(SAMPLES, watched)])
        history = history.after(Playback(drive=np.full((1, SAMPLES), float(number)), response=response))
    found = accept_segments(
        history, response_scale=np.array([1.0, 0.0]), sample_rate=RATE, settings=AcceptanceSettings()
    )
    assert np.all(found.drive == 2.0)


@pytest.mark.parametrize("first", [[0.3, 1.0], [1.0, 0.3]])
def test_errors_of_channels_are_added_as_shares_of_their_own_targets(first):
    """One gets worse, 0.3 to 0.5 of its target, the other better, 1 to 0.5 of its own: together it is better."""
    level = np.array([[900.0], [40.0]])
    target = level * np.ones((2, SAMPLES))
    history = IterationHistory(target=target)
    for number, shares in enumerate((first, [0.5, 0.5]), start=1):
        response = target - level * np.array(shares)[:, None]
        history = history.after(Playback(drive=np.full((1, SAMPLES), float(number)), response=response))
    found = accept_segments(history, response_scale=1.0 / level[:, 0], sample_rate=RATE, settings=AcceptanceSettings())
    assert np.all(found.drive == 2.0)
    assert not found.rolled_back.any()


def test_an_event_is_judged_by_as_much_before_it_as_behind_it():
    worse = tone(0.4)
    worse[:, 1000] += 20.0
    rolled_back = np.flatnonzero(accept(history_of(tone(0.5), worse)).rolled_back)
    assert rolled_back[0] < 1000 < rolled_back[-1]
    assert abs((1000 - rolled_back[0]) - (rolled_back[-1] - 1000)) <= 2


def test_a_record_shorter_than_the_windows_is_judged_too():
    target = np.ones((1, 7))
    history = IterationHistory(target=target)
    for number, error in enumerate((0.5, 0.2, 0.9), start=1):
        history = history.after(Playback(drive=np.full((1, 7), float(number)), response=target - error))
    np.testing.assert_allclose(accept(history).drive, 2.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"tolerance": 0.9},
        {"judged_seconds": 0.0},
        {"cross_fade_seconds": np.nan},
        {"smaller_step": 1.0},
        {"smallest_step": 0.0},
        {"larger_step": 0.5},
        {"larger_step": np.inf},
        {"tolerance": np.inf},
        {"negligible": 1.0},
        {"least_progress": 1.0},
        {"least_progress": -0.1},
        {"doubted_step": 0.0},
        {"doubted_step": 1.1},
    ],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must|in \("):
        AcceptanceSettings(**wrong)


def test_nothing_can_be_accepted_before_the_first_playback():
    with pytest.raises(ValueError, match="no playback"):
        accept(history_of())


def test_drives_are_blended_by_the_average_of_what_is_worse_over_a_hann_window():
    rng = np.random.default_rng(5)
    errors = [tone(0.5), tone(0.5) * np.repeat(rng.uniform(0.2, 2.0, 10), 201)[:SAMPLES]]
    found = accept(history_of(*errors), AcceptanceSettings(judged_seconds=0.1, least_progress=0.0))
    window = np.hanning(round(0.5 * RATE) + 1)
    expected = convolve1d(found.rolled_back.astype(float), window / window.sum(), mode="nearest")
    assert 0.2 < np.mean(found.rolled_back) < 0.8
    np.testing.assert_allclose(found.drive[0], 2.0 - expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.step_gain, 1.0 - 0.5 * expected, rtol=0.0, atol=1e-12)


def test_a_window_narrower_than_a_sample_judges_every_sample_by_itself():
    worse = np.random.default_rng(6).random(SAMPLES) < 0.5
    found = accept(
        history_of(np.full((1, SAMPLES), 0.5), np.where(worse, 1.0, 0.2)[None, :]),
        AcceptanceSettings(judged_seconds=1e-3),
    )
    np.testing.assert_array_equal(found.rolled_back, worse)
