"""Hold points as a campaign file has them, and decisions that do not fit together."""

import pytest

from duralab_settings import Decision, DecisionKind, HoldPoint, HoldSettings, SettingsError, parse_yaml


@pytest.mark.parametrize(
    ("text", "when", "bounds"),
    [
        ("never", HoldPoint.NEVER, (None, None)),
        ("first", HoldPoint.FIRST, (None, None)),
        ("each", HoldPoint.EACH, (None, None)),
        ("{predicted_peak: 1.2, predicted_damage: 2.0}", HoldPoint.PREDICTED, (1.2, 2.0)),
        ("{predicted_damage: 0.5}", HoldPoint.PREDICTED, (None, 0.5)),
    ],
)
def test_a_file_says_it_in_a_word_or_by_bounds_and_gets_it_back(text, when, bounds):
    given = parse_yaml(f"hold: {text}")["hold"]
    hold = HoldSettings.model_validate(given)
    assert (hold.when, hold.predicted_peak, hold.predicted_damage) == (when, *bounds)
    assert hold.model_dump(mode="json") == given


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("always", "is 'always'; give never, first, each"),
        (3, "is 3; give never, first, each"),
        ("predicted", "has no bound; give never"),
        ({}, "has no bound"),
        ({"when": "first", "predicted_peak": 1.2}, "waits first and has bounds"),
        ({"predicted_peak": 0.0}, "predicted_peak is 0.0; it must be greater than 0"),
        ({"predicted_peek": 1.2}, "unknown key 'predicted_peek'.* did you mean 'predicted_peak'"),
    ],
)
def test_what_is_no_hold_point_is_refused(given, sentence):
    with pytest.raises((SettingsError, ValueError), match=sentence):
        HoldSettings(**given) if isinstance(given, dict) else HoldSettings.model_validate(given)


SAID = {"proposal": 1, "name": "Ada", "reason": "as foreseen"}


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"name": ""}, "name"),
        ({"name": "  "}, "name"),
        ({"name": "A\x1b[2J"}, "name"),
        ({"name": "a" * 81}, "name"),
        ({"reason": "one\ntwo"}, "reason"),
        ({"reason": "r" * 1001}, "reason"),
        ({"proposal": 0}, "proposal"),
        ({"kind": "change"}, "update"),
        ({"scenario": "name: x"}, "update"),
        ({"kind": "back"}, "from_iteration"),
        ({"from_iteration": 2}, "from_iteration"),
        ({"kind": "maybe"}, "kind"),
    ],
)
def test_a_decision_that_does_not_fit_together_is_refused_with_its_field(given, field):
    with pytest.raises(SettingsError) as caught:
        Decision(**{**SAID, "kind": DecisionKind.PLAY, **given})
    assert caught.value.field == field


def test_name_and_reason_are_required():
    for key in ("name", "reason"):
        with pytest.raises(SettingsError, match=f"{key} is missing"):
            Decision(kind=DecisionKind.PLAY, **{name: value for name, value in SAID.items() if name != key})
