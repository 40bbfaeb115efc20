"""Settings of a campaign that corrects the drive of a worn specimen."""

import pytest

from duralab_proto.v1 import iterator_pb2
from duralab_settings import ResolvedUpdate, SecantSettings, UpdateKind
from duralab_settings.messages import fill_message, from_message
from sequencer.endurance.iterate_again import update_of_worn


def test_the_new_steps_count_more_than_the_old_model_and_everything_else_stays():
    before = ResolvedUpdate(
        kind=UpdateKind.SECANT, iteration_gain=(1.0, 0.5), gain_schedule=(0.8, 1.0), accept_segments=True
    )
    after = update_of_worn(before)
    assert after.iteration_gain == pytest.approx((0.9, 0.45))
    assert after.secant == SecantSettings(forgetting=0.3, prior_strength=0.3, each_line=True)
    unchanged = {"secant": before.secant, "iteration_gain": before.iteration_gain}
    assert after.model_copy(update=unchanged) == before


def test_what_a_person_made_to_follow_faster_stays_so():
    secant = SecantSettings(forgetting=0.1, prior_strength=0.01, caution=2.0)
    after = update_of_worn(ResolvedUpdate(kind=UpdateKind.SECANT, iteration_gain=(1.0,), secant=secant))
    assert after.secant == secant.model_copy(update={"each_line": True})


def test_a_message_holds_the_settings_also_where_it_had_none_of_the_secant_update():
    message = iterator_pb2.UpdateSettings(kind=iterator_pb2.UPDATE_KIND_SECANT)
    fill_message(message, ResolvedUpdate(kind=UpdateKind.SECANT, iteration_gain=(1.0,)))
    message.ClearField("secant")
    wanted = update_of_worn(from_message(message, ResolvedUpdate))
    fill_message(message, wanted)
    assert from_message(message, ResolvedUpdate) == wanted
