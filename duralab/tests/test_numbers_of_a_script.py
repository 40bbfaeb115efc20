"""Numbers of a script that the contract cannot hold are refused before anybody is asked."""

import numpy as np
import pytest
from test_identification import ESTIMATOR, EXCITATION, Answers, identifier
from test_labelled_signals import RIG

from duralab.errors import InputError
from duralab.lab.campaign_running import resume_campaign
from duralab.lab.playing import play_drive

UNUSED = object()


def play(seed):
    options = {"run": None, "real_time": False, "on_progress": UNUSED, "deadline": UNUSED}
    play_drive(UNUSED, RIG, np.zeros((2, 10)), seed=seed, **options)


def identify(seed):
    identifier(Answers(None)).plan("front_axle", EXCITATION, ESTIMATOR, seed=seed)


@pytest.mark.parametrize("seed", [-1, 2**63, 2**64])
@pytest.mark.parametrize("ask", [play, identify])
def test_a_seed_out_of_range(ask, seed):
    with pytest.raises(
        InputError, match=rf"^The seed is {seed}; it must be a whole number from 0 to 2\^63 - 1\.$"
    ) as caught:
        ask(seed)
    assert caught.value.field == "seed"


@pytest.mark.parametrize("number", [-1, 2**32])
def test_a_playback_to_build_on_out_of_range(number):
    options = dict.fromkeys(("settings", "describe", "folder", "place", "replace", "on_progress", "deadline"), None)
    with pytest.raises(
        InputError, match=f"^from_iteration is {number}; give the number of a playback from 1"
    ) as caught:
        resume_campaign(UNUSED, "demo", from_iteration=number, **options)
    assert caught.value.field == "from_iteration"
