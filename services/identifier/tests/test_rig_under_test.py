"""What a rig's description decides before anything moves, and the names that its channels lend to sentences."""

import pytest
from test_request_and_model import RIG, multisine, plan, request

from duralab_proto.v1 import identifier_pb2
from duralab_settings import SettingsError
from identifier.experiment import with_names

POLYNOMIAL = {"estimator__kind": identifier_pb2.ESTIMATOR_KIND_LOCAL_POLYNOMIAL}
RATIONAL = {"estimator__kind": identifier_pb2.ESTIMATOR_KIND_LOCAL_RATIONAL}


@pytest.mark.parametrize("make", [request, multisine])
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({**POLYNOMIAL, "estimator__local_half_width": 1000}, "wider than the spectrum"),
        ({**RATIONAL, "estimator__local_half_width": 1, "estimator__local_order": 6}, "0 equations for 20 unknowns"),
    ],
)
def test_a_local_method_without_enough_equations_is_refused_before_anything_is_played(make, changes, message):
    with pytest.raises(SettingsError, match=message) as refusal:
        plan(make(**{"estimator__block_samples": 256, "excitation__fade": 0.1, **changes}))
    assert refusal.value.field == "estimator.local_half_width"


@pytest.mark.parametrize("changes", [POLYNOMIAL, RATIONAL])
@pytest.mark.parametrize("make", [request, multisine])
def test_the_defaults_of_the_local_methods_are_enough(make, changes):
    plan(make(**changes))


@pytest.mark.parametrize(
    ("sentence", "named"),
    [
        ("Response 2 is clipped: 3 % at 7.", "Response force_2 is clipped: 3 % at 7."),
        (
            "The capture blocks of response 1 are not yet periodic",
            "The capture blocks of response force_1 are not yet periodic",
        ),
        (
            "These are dead: drive 0 stays at 0, drive 1 stays at 0",
            "These are dead: drive drive_0 stays at 0, drive drive_1 stays at 0",
        ),
        ("drives 0 and 1 are most alike", "drives drive_0 and drive_1 are most alike"),
        ("3 responses and 2 drives; more than 1 delay blocks", "3 responses and 2 drives; more than 1 delay blocks"),
    ],
)
def test_channels_are_called_by_their_names(sentence, named):
    assert with_names(sentence, RIG) == named
