import numpy as np
import pytest

from iterator import control_band

FREQUENCY = np.linspace(0.0, 100.0, 4001)


def test_drive_mask_is_exactly_one_wherever_the_target_has_energy():
    band = control_band(2.0, 60.0, sample_rate=200.0)
    drive, target = band.drive_mask(FREQUENCY), band.target_mask(FREQUENCY)
    assert np.all(drive[target > 0.0] == 1.0)
    assert np.all(drive[(FREQUENCY <= 1.0) | (FREQUENCY >= 66.0)] == 0.0)
    assert np.all(target[(FREQUENCY <= 1.5) | (FREQUENCY >= 63.0)] == 0.0)
    assert (band.lowest_driven, band.highest_driven) == (1.0, 66.0)


def test_a_target_is_whole_between_the_edges_of_its_band():
    band = control_band(0.8, 40.0, sample_rate=200.0)
    inside = (FREQUENCY >= 0.8) & (FREQUENCY <= 40.0)
    assert np.all(band.target_mask(FREQUENCY)[inside] == 1.0)
    time = np.arange(8001) / 200.0
    envelope = np.exp(-0.5 * ((time - 20.0) / 4.0) ** 2)
    edges = np.array([envelope * np.sin(2.0 * np.pi * f * time) for f in (1.0, 39.0)])
    np.testing.assert_allclose(band.limit_target(edges), edges, atol=1e-3)


def test_a_flank_takes_the_room_that_the_excited_band_leaves():
    band = control_band(0.7, 35.0, sample_rate=1000.0, excited=(0.4, 45.0))
    assert (band.lowest_driven, band.highest_driven) == pytest.approx((0.4, 38.5))
    stated = control_band(0.7, 35.0, sample_rate=1000.0, excited=(0.4, 36.0), lower_flank=0.2, upper_flank=1.0)
    assert (stated.lowest_driven, stated.highest_driven) == pytest.approx((0.5, 36.0))


@pytest.mark.parametrize(
    ("excited", "flanks", "words"),
    [
        ((0.65, 45.0), {}, "flank of at most 0.05 Hz"),
        ((0.4, 35.0), {}, "excite a wider band or control a narrower one."),
        ((0.4, 36.0), {"upper_flank": 2.0}, "flank of at most 1 Hz"),
        ((0.4, 30.0), {}, "ends at 30 Hz"),
        ((1.0, 45.0), {}, "begins at 1 Hz"),
    ],
)
def test_a_band_whose_flanks_leave_the_excited_band_is_refused(excited, flanks, words):
    with pytest.raises(ValueError, match=words):
        control_band(0.7, 35.0, sample_rate=1000.0, excited=excited, **flanks)


@pytest.mark.parametrize("flanks", [{"lower_flank": 5e-324}, {"upper_flank": 5e-324}, {"upper_flank": 1e-7}])
def test_a_flank_that_rings_longer_than_any_target_is_refused(flanks):
    with pytest.raises(ValueError, match="it must be at least 1e-06 Hz"):
        control_band(0.7, 35.0, sample_rate=1000.0, **flanks)


def test_a_target_begins_and_ends_at_rest():
    band = control_band(2.0, 60.0, sample_rate=200.0)
    steady = np.sin(2.0 * np.pi * 10.0 * np.arange(4001) / 200.0)[None]
    limited = band.limit_target(steady)
    start = np.abs(limited[0, :8])
    assert start.max() < 0.2
    # Beyond the fades it is as it was, but for the smooth flanks' ringing.
    assert np.max(np.abs(limited - steady)[:, 100:-100]) < 0.03


def test_a_tone_inside_keeps_its_waveform_and_one_outside_vanishes():
    band = control_band(2.0, 60.0, sample_rate=200.0)
    time = np.arange(4001) / 200.0
    envelope = np.exp(-0.5 * ((time - 10.0) / 2.0) ** 2)
    inside = envelope * np.sin(2.0 * np.pi * 10.0 * time)
    outside = envelope * np.sin(2.0 * np.pi * 80.0 * time)
    limited = band.limit_target(np.array([3600.0 + inside + outside, outside]))
    assert np.max(np.abs(limited[0] - inside)) < 1e-5
    assert np.max(np.abs(limited[1])) < 1e-6


def test_a_record_at_rest_on_any_level_has_no_dynamic_part():
    band = control_band(2.0, 60.0, sample_rate=200.0)
    level = np.linspace(3600.0, 3580.0, 3001)
    assert np.max(np.abs(band.limit_response(np.array([level, -level])))) < 0.05


@pytest.mark.parametrize("samples", [1, 7, 1001, 4096])
def test_any_length_comes_back_with_its_length(samples):
    band = control_band(2.0, 60.0, sample_rate=200.0)
    assert band.limit_response(np.ones((3, samples))).shape == (3, samples)


def test_a_pulse_at_the_start_leaves_nothing_at_the_end():
    band = control_band(2.0, 60.0, sample_rate=200.0)
    pulse = np.zeros((1, 4001))
    pulse[0, 5] = 1.0
    limited = band.limit_response(pulse)
    # Without padding the ringing before the pulse would stand at the end of the record.
    assert np.max(np.abs(limited[0, -200:])) < 1e-3 * np.max(np.abs(limited))


@pytest.mark.parametrize(("lowest", "highest"), [(0.0, 40.0), (5.0, 120.0), (40.0, 5.0), (5.0, 95.0), (np.nan, 40.0)])
def test_an_impossible_band_is_refused(lowest, highest):
    with pytest.raises(ValueError, match="band"):
        control_band(lowest, highest, sample_rate=200.0)


@pytest.mark.parametrize("lowest", [0.25, 0.5, 5.0])
def test_the_ringing_of_a_flank_decays_within_the_zeros_after_a_record(lowest):
    band = control_band(lowest=lowest, highest=40.0, sample_rate=200.0)
    # So long that next to nothing wraps around into what is looked at.
    length = 8 * band.ringing_samples
    frequency = np.fft.rfftfreq(length, 1.0 / band.sample_rate)
    for mask in (band.target_mask(frequency), band.drive_mask(frequency)):
        ringing = np.abs(np.fft.irfft(mask, length))
        assert np.max(ringing[band.ringing_samples : length // 2]) < 3e-6 * np.max(ringing)
