from dataclasses import replace

import numpy as np
import pytest

from duralab_drive_map import learn_drive_map
from duralab_spectra import rms

from .arc_rig import (
    KAPPA,
    LEVEL,
    NAMES,
    SAMPLE_RATE,
    UNITS,
    drive,
    estimated_model,
    exact_model,
    frequency_response,
    play_arc,
    play_linear,
)
from .arc_rig import model as model_of


def learn(u, y, model=None, **options):
    return learn_drive_map(u, y, model=model or exact_model(), names=NAMES, units=UNITS, **options)


def noisy(y, share=0.02, seed=9):
    return y + share * rms(y)[:, None] * np.random.default_rng(seed).standard_normal(y.shape)


def test_the_arc_of_a_made_up_rig_is_found():
    u = drive()
    learned = learn(u, play_arc(u))
    (term,) = learned.drive_map.terms
    assert (term.follower, term.product) == (1, (0, 0))
    assert learned.drive_map.static_coefficient(term) == pytest.approx(-KAPPA, rel=1e-3)
    assert learned.drive_map.describe() == ("lateral follows −3 /m × vertical²",)
    assert np.abs(term.coefficients[1:]).max() < 1e-2 * term.coefficients[0]
    assert learned.chosen[0].significance > 20.0
    assert learned.chosen[0].residual < 0.3
    assert learned.remarks == ()


def test_the_model_is_estimated_again_on_mapped_drives():
    u = drive(level=(0.025, 0.0015))
    y = noisy(play_arc(u), share=0.003)
    first = estimated_model(u, y)
    learned = learn(u, y, first, estimate=lambda mapped: estimated_model(mapped, y))
    (term,) = learned.drive_map.terms
    assert (term.follower, term.product) == (1, (0, 0))
    assert learned.drive_map.static_coefficient(term) == pytest.approx(-KAPPA, rel=0.05)
    frequency, frf = frequency_response()
    inside = (frequency > 3.0) & (frequency < 36.0)

    def wrong(model):
        missed = (model.frf - frf)[inside] * LEVEL
        return np.sqrt(np.mean(np.abs(missed) ** 2) / np.mean(np.abs(frf[inside] * LEVEL) ** 2))

    assert wrong(learned.model) < 0.5 * wrong(first)


@pytest.mark.parametrize("seed", range(6))
def test_a_linear_rig_chooses_no_term_and_keeps_its_model(seed):
    u = drive(seed=seed)
    y = noisy(play_linear(u), share=0.05, seed=seed)
    model = estimated_model(u, y)

    def never(mapped):
        raise AssertionError(f"No term was chosen, so {mapped.shape} is not estimated on.")

    learned = learn(u, y, model, estimate=never)
    assert learned.drive_map.is_identity
    assert learned.chosen == ()
    assert learned.model is model
    assert learned.drive_map.to_drive(u).tobytes() == u.tobytes()


def test_odd_nonlinearities_choose_no_term():
    u = drive()
    bent = np.vstack((u[:1] + 500.0 * u[:1] ** 3, u[1:]))
    y = noisy(play_linear(bent))
    assert learn(u, y, estimated_model(u, y)).drive_map.is_identity


def test_a_unit_changes_units_only():
    u = drive()
    y = noisy(play_arc(u))
    in_metres = learn(u, y)
    factor = np.array([1000.0, 1.0])
    frequency, frf = frequency_response()
    model = model_of(frequency, frf / factor)
    other = learn_drive_map(u * factor[:, None], y, model=model, names=NAMES, units=("mm", "m"))
    (term,), (other_term,) = in_metres.drive_map.terms, other.drive_map.terms
    np.testing.assert_allclose(other_term.coefficients, term.coefficients, rtol=1e-9, atol=1e-12)
    assert other.drive_map.static_coefficient(other_term) == pytest.approx(
        1e-6 * in_metres.drive_map.static_coefficient(term), rel=1e-9
    )
    assert other.drive_map.describe() == ("lateral follows −3e-06 m/mm² × vertical²",)


def test_a_term_would_follow_itself_and_is_passed_over():
    """The lateral drive's own square explains most; a drive that follows itself cannot be inverted."""
    u = drive(level=(0.01, 0.05))
    y = play_linear(np.array([u[0], u[1] + 20.0 * u[1] ** 2 + KAPPA * u[0] ** 2]))
    assert all(1 not in term.product for term in learn(u, y).drive_map.terms if term.follower == 1)


def test_a_record_that_is_too_short_or_too_narrow_learns_nothing_and_says_so():
    u = drive(seconds=30.0)
    learned = learn(u, play_arc(u))
    assert learned.drive_map.is_identity
    assert learned.remarks == (
        "No drive map is learned: the record holds 6 pieces of 8 s and 8 are needed; record 36 s or more.",
    )
    frequency, frf = frequency_response()
    u = drive()
    narrow = model_of(frequency, frf, identified=(10.0, 11.35))
    (said,) = learn(u, play_arc(u), narrow).remarks
    assert "identify a wider band" in said
    assert learn(u[:, :100], play_arc(u[:, :100])).drive_map.is_identity


def test_a_product_that_counts_only_now_and_then_is_not_significant():
    u = drive()
    time = np.arange(u.shape[1]) / SAMPLE_RATE
    now_and_then = np.where((np.abs(time - 8.0) < 2.0) | (np.abs(time - 28.0) < 2.0), 1.0, 0.0)
    bent = np.array([u[0], u[1] + 20.0 * now_and_then * u[0] ** 2])
    learned = learn(u, play_linear(bent))
    assert learned.drive_map.is_identity
    (said,) = learned.remarks
    assert said.startswith("The term lateral after vertical² is not chosen: its coefficients are ")
    assert said.endswith("standard deviations away from 0 and 4 are needed; a longer or louder record tells more.")


def test_a_term_that_a_new_estimate_makes_needless_is_dropped():
    u = drive(level=LEVEL * (0.3, 1.0))
    y = noisy(play_arc(u), share=0.03)
    model = exact_model()
    assert not learn(u, y, model).drive_map.is_identity
    frequency, frf = frequency_response()
    blind = model_of(frequency, 1e-9 * frf)
    learned = learn(u, y, model, estimate=lambda mapped: blind)
    assert learned.drive_map.is_identity
    assert learned.model is model
    assert "with it a model that is estimated again leaves" in learned.remarks[-1]


def weaker(drive_map, share):
    """The map with a share of its coefficients, of a record with less than half of the motion."""
    terms = tuple(
        replace(term, coefficients=tuple(0.4 * share * each for each in term.coefficients)) for term in drive_map.terms
    )
    return replace(drive_map, terms=terms, scale=tuple(0.4 * each for each in drive_map.scale))


def test_a_map_that_knows_two_thirds_of_an_arc_learns_the_rest_from_a_louder_record():
    u = drive(seed=3, level=2.0 * LEVEL)
    start = weaker(learn(u, play_arc(u), exact_model()).drive_map, 2.0 / 3.0)
    again = learn(u, play_arc(u), exact_model(), start=start)
    (term,) = again.drive_map.terms
    assert again.drive_map.static_coefficient(term) == pytest.approx(-KAPPA, rel=0.01)
    # The same record cannot say more than it did.
    exact = weaker(again.drive_map, 1.0)
    same = learn(u, play_arc(u), exact_model(), start=exact)
    assert same.drive_map is exact
    assert same.chosen == ()
    assert "explains the record as well" in same.remarks[0]


def test_learned_again_other_drives_may_follow_its_products_and_no_other_product_is_added():
    # Three delays: lateral follows an arc, longitudinal a weak one, and a product of others explains a wrong FRF.
    rng, names, samples = np.random.default_rng(5), ("vertical", "lateral", "longitudinal"), round(75.0 * SAMPLE_RATE)
    noise = np.vstack([drive(seed=3), drive(seed=4)[1:]])
    u = noise / rms(noise)[:, None] * np.array([0.02, 0.004, 0.004])[:, None]
    vertical, lateral = u[:2]
    followed = [0.0 * vertical, KAPPA * vertical**2, 0.5 * vertical**2 + 10.0 * vertical * lateral]
    y = np.roll(u + followed, 1, axis=1)
    y += 0.02 * rms(y)[:, None] * rng.standard_normal((3, samples))
    frequency, _ = frequency_response()
    delay = np.exp(-2j * np.pi * frequency / SAMPLE_RATE)[:, None, None] * np.eye(3)
    model = model_of(frequency, delay)

    def learned(**options):
        found = learn_drive_map(u, y, model=model, names=names, units=("m",) * 3, **options).drive_map
        return found, {(term.follower, term.product) for term in found.terms}

    whole, all_terms = learned()
    assert all_terms == {(1, (0, 0)), (2, (0, 0)), (2, (0, 1))}
    start = weaker(replace(whole, terms=tuple(term for term in whole.terms if term.follower == 1)), 2.0 / 3.0)
    again, terms = learned(start=start)
    assert terms == {(1, (0, 0)), (2, (0, 0))}
    coefficients = {term.follower: again.static_coefficient(term) for term in again.terms}
    assert coefficients == {1: pytest.approx(-KAPPA, rel=0.02), 2: pytest.approx(-0.5, rel=0.05)}


def test_a_quieter_record_teaches_nothing_again():
    u = drive(seed=3)
    start = learn(u, play_arc(u), exact_model()).drive_map
    start = replace(start, scale=tuple(0.9 * each for each in start.scale))
    again = learn(u, play_arc(u), exact_model(), start=start)
    assert again.drive_map is start
    assert again.remarks == (
        "The drive map is not learned again: vertical moved less than 1.2 times as much as in the identification.",
    )
    with pytest.raises(ValueError, match="`estimate` and `start` are both given"):
        learn(u, play_arc(u), exact_model(), start=start, estimate=lambda mapped: exact_model())


def test_a_response_without_weight_does_not_count():
    u = drive()
    y = play_arc(u)
    spoilt = np.vstack((y[:1], 0.0 * y[1:]))
    learned = learn(u, spoilt, response_weight=(1.0 / rms(y)[0], 0.0))
    assert [(term.follower, term.product) for term in learned.drive_map.terms] == [(1, (0, 0))]


def test_a_drive_that_rests_is_in_no_term():
    u = drive()
    u[1] = 0.0
    learned = learn(u, play_linear(u))
    assert learned.drive_map.is_identity
    assert learned.drive_map.scale[1] == 1.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"y": lambda y: y[:, :-1]}, "a map is learned from both of one record"),
        ({"y": lambda y: y[:1]}, "on the rig that the model is of"),
        ({"names": ("vertical",)}, "1 names and 2 units for 2 drives"),
        ({"weight": (1.0,)}, "for each of 2 responses"),
        ({"weight": (1.0, -1.0)}, "0 or more"),
        ({"may_follow": (True,)}, "may_follow has 1 values and there are 2 drives"),
    ],
)
def test_records_that_do_not_fit_are_refused(change, said):
    u = drive()
    y = change.get("y", lambda y: y)(play_arc(u))
    with pytest.raises(ValueError, match=said):
        learn_drive_map(
            u,
            y,
            model=exact_model(),
            names=change.get("names", NAMES),
            units=UNITS,
            response_weight=change.get("weight"),
            may_follow=change.get("may_follow"),
        )


def test_a_drive_that_may_not_follow_is_in_no_term():
    u = drive()
    assert learn(u, play_arc(u), may_follow=(True, False)).drive_map.is_identity
