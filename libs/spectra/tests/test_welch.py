import numpy as np
import pytest
from scipy import signal

import duralab_spectra

SETTINGS = {"block_samples": 256, "overlap": 0.5, "sample_rate": 1000.0}


def csd_loop(a, b, *, block_samples, overlap, sample_rate):
    def one(first, second):
        return signal.csd(
            second,
            first,
            fs=sample_rate,
            window=duralab_spectra.hann_periodic(block_samples),
            nperseg=block_samples,
            noverlap=block_samples - duralab_spectra.hop_samples(block_samples, overlap),
            detrend=False,
        )[1]

    return np.stack([[one(x, y) for y in b] for x in a]).transpose(2, 0, 1)


@pytest.fixture
def records():
    generator = np.random.default_rng(1)
    drive = generator.standard_normal((3, 9001)) + 0.7
    response = generator.standard_normal((4, 9001)) + generator.standard_normal((4, 3)) @ drive
    return response, drive


@pytest.mark.parametrize(("block", "overlap"), [(256, 0.5), (512, 0.75), (100, 0.0), (9000, 0.5)])
def test_cross_spectra_equal_a_csd_loop(records, block, overlap):
    chosen = {"block_samples": block, "overlap": overlap, "sample_rate": 500.0}
    expected = csd_loop(*records, **chosen)
    result = duralab_spectra.cross_spectra(*records, **chosen)
    assert np.max(np.abs(result - expected)) <= 1e-12 * np.max(np.abs(expected))
    assert result.flags.c_contiguous


@pytest.mark.parametrize("piece", [1, 97, 1000, 9001])
def test_the_running_estimate_does_not_depend_on_how_the_record_is_cut(records, piece):
    response, drive = (record[:, :2000] for record in records) if piece == 1 else records
    running = duralab_spectra.CrossSpectra(4, 3, **SETTINGS)
    for start in range(0, drive.shape[1], piece):
        running.add(response[:, start : start + piece], drive[:, start : start + piece])
    result = running.estimate()
    expected = duralab_spectra.cross_spectra(response, drive, **SETTINGS)
    scale = np.max(np.abs(expected))
    assert np.max(np.abs(result.s_ab - expected)) <= 1e-12 * scale
    assert np.max(np.abs(result.s_bb - duralab_spectra.cross_spectra(drive, drive, **SETTINGS))) <= 1e-12 * scale
    assert np.max(np.abs(result.auto_a - duralab_spectra.auto_spectra(response, **SETTINGS))) <= 1e-12 * scale
    assert result.blocks == duralab_spectra.count_blocks(drive.shape[1], 256, 0.5)


def test_paired_spectra_are_the_diagonal(records):
    response, drive = records
    expected = np.einsum("fii->fi", duralab_spectra.cross_spectra(response[:3], drive, **SETTINGS))
    np.testing.assert_allclose(duralab_spectra.paired_spectra(response[:3], drive, **SETTINGS), expected, rtol=1e-12)


def test_the_auto_spectrum_integrates_to_the_power_of_white_noise():
    record = np.random.default_rng(5).standard_normal((1, 200_000))
    density = duralab_spectra.auto_spectra(record, **SETTINGS)
    assert density.sum() * 1000.0 / 256 == pytest.approx(float(np.mean(record**2)), rel=0.01)


def test_a_delayed_response_has_falling_phase():
    delay, block, rate = 3, 128, 100.0
    drive = np.random.default_rng(2).standard_normal((1, 50_000))
    response = np.roll(drive, delay, axis=1)
    chosen = {"block_samples": block, "overlap": 0.5, "sample_rate": rate}
    frf = duralab_spectra.cross_spectra(response, drive, **chosen) / duralab_spectra.cross_spectra(
        drive, drive, **chosen
    )
    expected = np.exp(-2j * np.pi * duralab_spectra.line_frequencies(block, rate) * delay / rate)
    # The delay shifts the response a little in its window, so the sign is exact and the value near.
    np.testing.assert_allclose(frf[:, 0, 0], expected, atol=0.05)
    assert np.all(np.diff(np.unwrap(np.angle(frf[:-1, 0, 0]))) < 0.0)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.ones((2, 300)), np.ones((2, 301)), "300 and 301 samples"),
        (np.ones((2, 100)), np.ones((2, 100)), "fewer than one block"),
        (np.full((1, 300), np.nan), np.ones((1, 300)), "must be finite"),
        (np.ones(300), np.ones((1, 300)), "shape"),
        (np.ones((1, 300), dtype=complex), np.ones((1, 300)), "real"),
    ],
)
def test_unusable_records_are_refused(a, b, message):
    with pytest.raises(ValueError, match=message):
        duralab_spectra.cross_spectra(a, b, **SETTINGS)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("sample", [0, 255, 256, 9_000, 9_999])
@pytest.mark.parametrize("powered", [False, True])
@pytest.mark.parametrize("without_mean", [False, True])
def test_a_value_that_is_not_finite_is_named_and_spoils_nothing(value, sample, powered, without_mean):
    random = np.random.default_rng(3)
    a, b = random.standard_normal((2, 3, 10_000))
    record = a if powered else b
    running, sound = (duralab_spectra.CrossSpectra(3, 3, without_mean=without_mean, **SETTINGS) for _ in range(2))
    running.add(a, b)
    sound.add(a, b)
    wrong = record.copy()
    wrong[1, sample] = value
    with pytest.raises(ValueError, match=rf"holds {value} in channel 1 at sample {sample};"):
        running.add(*((wrong, b) if powered else (a, wrong)))
    blocks = sound.estimate().blocks
    estimate = running.estimate()
    assert estimate.blocks >= blocks
    assert np.isfinite(estimate.s_ab).all()
    assert np.isfinite(estimate.s_bb).all()
    assert np.isfinite(estimate.auto_a).all()
    if sample == 0:
        np.testing.assert_array_equal(estimate.s_ab, sound.estimate().s_ab)


@pytest.mark.parametrize("piece", [50, 200])
def test_a_piece_with_a_value_that_is_not_finite_is_refused_at_once_however_short_it_is(piece):
    random = np.random.default_rng(4)
    running, sound = (duralab_spectra.CrossSpectra(1, 1, **SETTINGS) for _ in range(2))
    for _ in range(7):
        a, b = random.standard_normal((2, 1, piece))
        running.add(a, b)
    wrong = a.copy()
    wrong[0, -1] = np.nan
    with pytest.raises(ValueError, match=f"a holds nan in channel 0 at sample {piece - 1};"):
        running.add(wrong, b)
    blocks = running.blocks
    a, b = random.standard_normal((2, 1, 256))
    running.add(a, b)
    sound.add(a, b)
    assert running.blocks == blocks + sound.blocks == blocks + 1


def test_an_estimate_of_less_than_a_block_is_refused():
    running = duralab_spectra.CrossSpectra(1, 1, **SETTINGS)
    running.add(np.ones((1, 255)), np.ones((1, 255)))
    with pytest.raises(ValueError, match="shorter than one block"):
        running.estimate()
    with pytest.raises(ValueError, match="2 and 1 channels"):
        running.add(np.ones((2, 255)), np.ones((1, 255)))


def test_chosen_lines_are_those_of_the_whole_estimate(records):
    whole, some = (
        duralab_spectra.CrossSpectra(4, 3, **SETTINGS),
        duralab_spectra.CrossSpectra(4, 3, chosen=slice(7, 90), **SETTINGS),
    )
    for running in (whole, some):
        running.add(*records)
    expected, found = whole.estimate(), some.estimate()
    for name in ("frequency", "s_ab", "s_bb", "auto_a"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name)[7:90], rtol=1e-12)
    with pytest.raises(ValueError, match="next to each other"):
        duralab_spectra.CrossSpectra(4, 3, chosen=slice(200, 500), **(SETTINGS | {"block_samples": 16}))
    with pytest.raises(ValueError, match="ask for one of the two"):
        duralab_spectra.CrossSpectra(4, 3, chosen=slice(7, 90), without_mean=True, **SETTINGS)


@pytest.mark.parametrize("without_mean", [False, True])
@pytest.mark.parametrize("further", [1, 13, 40])
def test_further_channels_change_no_byte_of_the_others_and_are_averaged_with_them(records, further, without_mean):
    response, drive = records
    added = np.random.default_rng(2).standard_normal((further, drive.shape[1])) + drive[:1] ** 2
    together = np.vstack([drive, added])
    alone, plain, found = (
        duralab_spectra.CrossSpectra(4, b.shape[0], without_mean=without_mean, further=count, **SETTINGS)
        for b, count in ((drive, 0), (together, 0), (together, further))
    )
    for running, b in ((alone, drive), (plain, together), (found, together)):
        running.add(response[:, :8800], b[:, :8800])
        running.add(response[:, 8800:], b[:, 8800:])
    own, whole, found = alone.estimate(), plain.estimate(), found.estimate()
    assert np.ascontiguousarray(found.s_ab[:, :, :3]).tobytes() == own.s_ab.tobytes()
    assert np.ascontiguousarray(found.s_bb[:, :3, :3]).tobytes() == own.s_bb.tobytes()
    assert found.auto_a.tobytes() == own.auto_a.tobytes()
    for name in ("s_ab", "s_bb"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(getattr(found, name), expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_means_come_off_and_stretches_are_kept_apart():
    """The mean of all samples, not of each block; a block never spans two stretches."""
    generator = np.random.default_rng(1)
    first, second = generator.standard_normal((2, 2, 700)) + 5.0
    plain = {"block_samples": 256, "overlap": 0.5, "sample_rate": 1000.0}
    running = duralab_spectra.CrossSpectra(1, 1, without_mean=True, full=True, **plain)
    for stretch in (first, second):
        running.add(stretch[:1], stretch[1:])
        running.end_stretch()
    found = running.estimate()
    mean = np.concatenate((first, second), axis=1).mean(axis=1, keepdims=True)
    expected = np.mean(
        [duralab_spectra.cross_spectra(part - mean, part - mean, **plain) for part in (first, second)], axis=0
    )
    np.testing.assert_allclose(found.s_ab[:, 0, 0], expected[:, 0, 1], atol=1e-12)
    np.testing.assert_allclose(found.s_bb[:, 0, 0], expected[:, 1, 1], atol=1e-12)
    np.testing.assert_allclose(found.s_aa[:, 0, 0], expected[:, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.auto_a[:, 0], expected[:, 0, 0].real, atol=1e-12)
    assert found.blocks == running.blocks == 2 * duralab_spectra.count_blocks(700, 256, 0.5)
    assert found.independent_averages == pytest.approx(
        2
        * duralab_spectra.independent_averages(
            duralab_spectra.hann_periodic(256), 128, duralab_spectra.count_blocks(700, 256, 0.5)
        )
    )
