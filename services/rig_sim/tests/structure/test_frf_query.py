"""The query for a rig's FRF: the analytic one, or a fault with the code of the contract."""

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_gateway.server import answer_frf
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import rig_pb2
from rig_sim.bus import describe_rig
from rig_sim.loading import load_any_rig
from rig_sim.specimen.specimen import shipped_specimens


@pytest.fixture(scope="module")
def aerospace():
    return load_any_rig(shipped_specimens()["aerospace"])


def asked(rig, frequency):
    return answer_frf(
        rig, describe_rig(rig), rig_pb2.RigFrfRequest(frequency=to_array(np.asarray(frequency, dtype=float)))
    )


def test_the_answer_is_the_sampled_frf_at_the_lines_asked_for(aerospace):
    frequency = np.array([0.0, 5.4, 31.5, 256.0])
    answer = asked(aerospace, frequency)
    assert (answer.rig, answer.content_hash) == ("aerospace", aerospace.content_hash)
    np.testing.assert_array_equal(from_array(answer.frequency), frequency)
    np.testing.assert_array_equal(from_array(answer.frf), aerospace.sampled_frf(frequency))
    assert from_array(answer.frf).shape == (4, 6, 4)


def test_a_rig_that_does_not_know_it_says_unimplemented(front_axle):
    with pytest.raises(FaultError, match="front_axle does not know its FRF") as caught:
        asked(front_axle, [1.0])
    assert caught.value.code_name == "UNIMPLEMENTED"


@pytest.mark.parametrize("frequency", [[], [-1.0], [1.0, 257.0]])
def test_frequencies_that_are_none_are_refused(aerospace, frequency):
    with pytest.raises(FaultError, match="from 0 to 256 Hz") as caught:
        asked(aerospace, frequency)
    assert (caught.value.code_name, caught.value.field) == ("INVALID_ARGUMENT", "frequency")
