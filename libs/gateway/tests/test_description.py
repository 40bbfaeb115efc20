"""A description that cannot be served is one sentence, before anything is on the bus."""

import numpy as np
import pytest
from rigs import Springs

from duralab_bus import ConfigError
from duralab_gateway import complete_description
from duralab_proto.arrays import to_array


def changed(change):
    told = Springs().describe()
    change(told)
    return told


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: setattr(t, "rig", "My Rig"), "rig: The rig 'My Rig' is not a name"),
        (lambda t: setattr(t, "sample_rate", 0.0), "springs: sample_rate is 0; it must be above 0."),
        (lambda t: setattr(t, "longest_drive_seconds", np.inf), "springs: longest_drive_seconds is inf"),
        (lambda t: t.ClearField("drives"), "springs: drives is empty; describe one channel or more."),
        (lambda t: t.ClearField("responses"), "springs: responses is empty"),
        (lambda t: setattr(t.responses[1], "name", "a_force"), "the names of responses are a_force, a_force; each"),
        (lambda t: setattr(t.drives[0], "maximum", -0.1), "a_stroke has the range -0.1 to -0.1; minimum must be below"),
        (lambda t: setattr(t.drives[0], "minimum", 0.01), "a_stroke may go from 0.01 to 0.1; a rig rests at zero"),
        (lambda t: setattr(t.drives[0], "slew_limit", -1.0), "slew_limit of a_stroke is -1; it must be 0 or more."),
        (
            lambda t: setattr(t.drives[0], "actuator_speed", float("nan")),
            "actuator_speed of a_stroke is nan; it must be finite, 0 or more.",
        ),
        (lambda t: t.static_response.CopyFrom(to_array(np.zeros(3))), "springs: static_response"),
    ],
)
def test_what_cannot_be_served_is_one_sentence(change, sentence):
    with pytest.raises(ConfigError) as caught:
        complete_description(changed(change))
    assert sentence in str(caught.value)


def test_what_a_rig_says_of_itself_is_not_changed():
    told = Springs().describe()
    assert complete_description(told).block_samples == 20
    assert told == Springs().describe()
