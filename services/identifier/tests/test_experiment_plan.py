import numpy as np
import pytest
from short_experiments import RATE, settings_of

import duralab_spectra
from duralab_settings import ExcitationKind
from identifier.excitation import design_experiment, plan_experiment, shortest_delay_seconds


def plan(drives=3, **changes):
    return plan_experiment(settings_of(drives, **changes), drives=drives, sample_rate=RATE)


@pytest.mark.parametrize("kind", list(ExcitationKind), ids=lambda kind: kind.value)
def test_the_plan_is_what_the_design_does(kind):
    settings = settings_of(kind=kind)
    drive = design_experiment(settings, drives=3, sample_rate=RATE).drive
    told = plan_experiment(settings, drives=3, sample_rate=RATE)
    assert drive.shape == (3, told.samples)
    assert told.duration_seconds == drive.shape[1] / RATE <= 40.0
    assert told.frequency_resolution == RATE / 2048
    # 0.5 to 50 Hz on a grid of 0.48828125 Hz: lines 2 to 102.
    assert told.lines == 101


def test_as_many_realisations_are_played_as_fit():
    # Three experiments of three blocks: 18.432 s a realisation, and a fade of 0.25 s at the end.
    told = plan(duration=2 * 18.432 + 0.25)
    assert (told.realisations, told.experiments_per_realisation, told.periods) == (2, 3, 2)
    assert told.samples == 2 * 18_432 + 250
    assert plan(duration=2 * 18.432 + 0.249).realisations == 1
    # The two periods of a capture average noise, but hold the same distortion.
    assert (told.blocks, told.independent_averages) == (12, 6.0)
    assert told.delay_seconds_share == pytest.approx(1.0 - 12 * 2048 / 37_114)


def test_pure_random_counts_overlapping_blocks_and_what_they_are_worth():
    told = plan(kind=ExcitationKind.PURE_RANDOM)
    assert told.blocks == duralab_spectra.count_blocks(39_500, 2048, 0.5)
    worth = duralab_spectra.independent_averages(duralab_spectra.hann_periodic(2048), 1024, told.blocks)
    assert told.independent_averages == worth < told.blocks
    assert told.delay_seconds_share == pytest.approx(0.5 / 40.0)


def test_repeats_multiply_the_time_and_the_averages_but_not_the_realisations():
    once, twice = plan(realisations=1), plan(realisations=1, repeats=2)
    assert twice.realisations == once.realisations == 1
    assert twice.blocks == 2 * once.blocks
    assert twice.samples - 250 == 2 * (once.samples - 250)


def test_the_delay_is_that_after_which_a_mode_has_decayed_to_the_remainder():
    delay = shortest_delay_seconds(natural_frequency=8.0, damping_ratio=0.02, remainder=1e-3)
    envelope = np.exp(-0.02 * 2.0 * np.pi * 8.0 * delay)
    assert envelope == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize("wrong", [{"natural_frequency": 0.0}, {"damping_ratio": 1.0}, {"remainder": np.nan}])
def test_a_mode_that_is_none_is_refused(wrong):
    with pytest.raises(ValueError, match="above 0 and below 1"):
        shortest_delay_seconds(**({"natural_frequency": 8.0, "damping_ratio": 0.02, "remainder": 1e-3} | wrong))
