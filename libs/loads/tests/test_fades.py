import numpy as np
import pytest

from duralab_loads import join_sections, rising_fade, taper_ends
from duralab_loads.fades import separate_sections


def test_what_fades_out_and_what_fades_in_add_up_to_the_whole():
    for samples in (1, 2, 7, 1000):
        fade = rising_fade(samples)
        np.testing.assert_allclose(fade + fade[::-1], 1.0, atol=1e-15)
        assert np.diff(fade, prepend=0.0).max() <= np.pi / 2 / samples


def test_a_record_cut_in_two_and_joined_again_is_itself():
    record = np.random.default_rng(1).standard_normal((3, 500))
    joined = join_sections(record, [(0, 300), (260, 500)], fade_samples=40)
    np.testing.assert_allclose(joined, record, atol=1e-14)


def test_sections_join_in_the_order_given_without_a_fade():
    record = np.arange(20.0).reshape(1, 20)
    joined = join_sections(record, [(10, 13), (2, 4), (10, 12)], fade_samples=0)
    np.testing.assert_array_equal(joined[0], [10, 11, 12, 2, 3, 10, 11])


def test_a_joint_between_two_levels_is_no_steeper_than_its_fade():
    record = np.concatenate([np.zeros(400), np.full(400, 50.0)])[np.newaxis]
    joined = join_sections(record, [(500, 800), (0, 300)], fade_samples=100)
    assert joined.shape[1] == 500
    assert np.abs(np.diff(joined)).max() <= 50.0 * np.pi / 2 / 100
    np.testing.assert_array_equal(joined[0, :200], 50.0)
    np.testing.assert_array_equal(joined[0, 300:], 0.0)


@pytest.mark.parametrize(
    ("sections", "sentence"),
    [
        ([], "no section"),
        ([(0, 11)], "must lie within the record of 10"),
        ([(5, 5)], "hold a sample"),
        ([(0, 10), (2, 7), (0, 10)], "Section 1 is 5 samples long and its fades need 6"),
    ],
)
def test_sections_that_cannot_be_joined_are_refused(sections, sentence):
    with pytest.raises(ValueError, match=sentence):
        join_sections(np.zeros((1, 10)), sections, fade_samples=3)


def test_sections_to_keep_whole_get_their_fades_from_outside_and_neighbours_merge():
    assert separate_sections([(50, 60), (70, 80), (200, 210)], fade_samples=10, samples=300) == [(50, 90), (190, 210)]
    assert separate_sections([(5, 60)], fade_samples=10, samples=300) == [(5, 60)]


def test_a_taper_begins_and_ends_at_its_level_and_leaves_the_middle():
    record = np.random.default_rng(2).standard_normal((2, 400)) + np.array([[5.0], [-3.0]])
    tapered = taper_ends(record, fade_samples=100, levels=[5.0, -3.0])
    np.testing.assert_array_equal(tapered[:, 100:300], record[:, 100:300])
    np.testing.assert_allclose(tapered[:, [0, -1]], [[5.0, 5.0], [-3.0, -3.0]], atol=1e-3)
    # Of a level signal nothing changes, and a record turned around is tapered as before.
    np.testing.assert_array_equal(taper_ends(np.full((1, 50), 2.0), fade_samples=25, levels=2.0), 2.0)
    np.testing.assert_array_equal(
        taper_ends(record[:, ::-1], fade_samples=30), taper_ends(record, fade_samples=30)[:, ::-1]
    )
    with pytest.raises(ValueError, match="Two fades of 201 samples do not fit into 400"):
        taper_ends(record, fade_samples=201)
