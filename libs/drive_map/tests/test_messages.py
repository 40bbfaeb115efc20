import numpy as np
import pytest

from duralab_drive_map import learn_drive_map
from duralab_drive_map.messages import from_message, to_message
from duralab_proto.arrays import ArrayError, to_array
from duralab_proto.v1.array_pb2 import Channel

from .arc_rig import NAMES, SAMPLE_RATE, UNITS, drive, exact_model, play_arc

CHANNELS = [Channel(name=name, unit=unit) for name, unit in zip(NAMES, UNITS, strict=True)]


@pytest.fixture(scope="module")
def learned():
    u = drive()
    return learn_drive_map(u, play_arc(u), model=exact_model(), names=NAMES, units=UNITS)


def test_a_map_survives_the_bus_unchanged(learned):
    message = to_message(learned)
    assert from_message(message, drives=CHANNELS, sample_rate=SAMPLE_RATE) == learned.drive_map
    (term,) = message.terms
    assert term.sentence == "lateral follows −3 /m × vertical²"
    assert term.significance == learned.chosen[0].significance


def test_a_map_that_stays_is_not_said_again_but_why(learned):
    quieter = 0.1 * drive()
    kept = learn_drive_map(
        quieter, play_arc(quieter), model=exact_model(), names=NAMES, units=UNITS, start=learned.drive_map
    )
    message = to_message(kept)
    assert list(message.terms) == []
    assert list(message.remarks) == list(kept.remarks) != []


def test_a_damaged_map_is_refused(learned):
    def damaged(change):
        message = to_message(learned)
        change(message)
        return message

    with pytest.raises(ValueError, match="close a cycle"):
        from_message(damaged(lambda m: setattr(m.terms[0], "follower", 0)), drives=CHANNELS, sample_rate=SAMPLE_RATE)
    with pytest.raises(ValueError, match="counted from 0"):
        from_message(damaged(lambda m: setattr(m.terms[0], "follower", 7)), drives=CHANNELS, sample_rate=SAMPLE_RATE)
    with pytest.raises(ArrayError):
        from_message(
            damaged(lambda m: m.scale.CopyFrom(to_array(np.ones(3)))), drives=CHANNELS, sample_rate=SAMPLE_RATE
        )
    with pytest.raises(ArrayError):
        from_message(
            damaged(lambda m: m.terms[0].coefficients.CopyFrom(to_array(np.full(3, np.nan)))),
            drives=CHANNELS,
            sample_rate=SAMPLE_RATE,
        )
