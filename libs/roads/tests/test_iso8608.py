import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import coherence, welch

from duralab_roads import RoadClass, iso8608_road, roughness_coefficient, track_coherence


@pytest.fixture(scope="module")
def long_road():
    return iso8608_road(
        road_class=RoadClass.C,
        length_m=20_000.0,
        seed=5,
        spacing_m=0.1,
        lateral_positions=(-0.75, 0.75),
        shortest_wavelength_m=0.4,
    )


def test_the_tracks_have_the_spectrum_of_the_standard(long_road):
    wavenumber, density = welch(long_road.elevation.T, fs=1 / 0.1, nperseg=4096, detrend=False)
    for lowest in 0.04 * 2.0 ** np.arange(5):
        octave = (wavenumber >= lowest) & (wavenumber < 2 * lowest)
        ratio = density[:, octave] / (256e-6 * (wavenumber[octave] / 0.1) ** -2)
        assert ratio.mean(axis=1) == pytest.approx([1.0, 1.0], abs=0.08)


def test_there_is_nothing_outside_the_band(long_road):
    wavenumber, density = welch(long_road.elevation.T, fs=1 / 0.1, nperseg=4096, detrend=False, window="blackmanharris")
    inside = 256e-6 * (2.4 / 0.1) ** -2
    assert density[:, wavenumber > 2.6].max() < 1e-3 * inside


def test_left_and_right_are_as_coherent_as_the_isotropic_surface_says(long_road):
    wavenumber, squared = coherence(*long_road.elevation.T, fs=1 / 0.1, nperseg=2048, detrend=False)
    expected = track_coherence(wavenumber, 1.5) ** 2
    for lowest in (0.03, 0.06, 0.12, 0.24, 0.5, 1.0):
        octave = (wavenumber >= lowest) & (wavenumber < 2 * lowest)
        assert squared[octave].mean() == pytest.approx(expected[octave].mean(), abs=0.04)
    assert track_coherence(0.02, 1.5) ** 2 > 0.9
    assert track_coherence(1.0, 1.5) ** 2 < 0.01


@pytest.mark.parametrize("wavenumber", [0.03, 0.1, 0.4])
@pytest.mark.parametrize("distance", [0.1, 0.75, 1.5])
def test_the_coherence_is_that_of_a_two_dimensional_spectrum(wavenumber, distance):
    # An isotropic surface with S(n1, n2) = (n1² + n2²)^(-3/2) has n^-2 tracks; integrate over n2.
    def spectrum(across):
        return (wavenumber**2 + across**2) ** -1.5

    cross, _ = quad(spectrum, 0, np.inf, weight="cos", wvar=2 * np.pi * distance)
    own, _ = quad(spectrum, 0, np.inf)
    assert track_coherence(wavenumber, distance) == pytest.approx(cross / own, abs=1e-6)


def test_the_variance_is_the_integral_of_the_spectrum():
    variances = [
        iso8608_road(
            road_class="D",
            length_m=500,
            seed=seed,
            spacing_m=0.25,
            shortest_wavelength_m=0.5,
            lateral_positions=(-2, 2),
        ).elevation.var()
        for seed in range(60)
    ]
    assert np.mean(variances) == pytest.approx(1024e-6 * 0.1**2 * (50 - 0.5), rel=0.07)


def test_one_seed_gives_the_same_bytes_and_another_seed_another_road():
    first, again, other = (iso8608_road(road_class="C", length_m=60, seed=seed) for seed in (1, 1, 2))
    assert first.elevation.tobytes() == again.elevation.tobytes()
    assert not np.allclose(first.elevation, other.elevation)
    assert first.length == pytest.approx(60)


def test_the_end_of_a_road_does_not_run_back_into_its_beginning():
    gaps = [np.ptp(iso8608_road(road_class="C", length_m=100, seed=seed).elevation[[0, -1], 2]) for seed in range(20)]
    assert np.mean(gaps) > 0.005


def test_between_two_classes_lies_their_geometric_mean():
    assert roughness_coefficient("C") == 256e-6
    assert roughness_coefficient("c/d") == pytest.approx(512e-6)
    assert roughness_coefficient(RoadClass.E) == 4096e-6
    assert roughness_coefficient(3e-4) == 3e-4


@pytest.mark.parametrize("road_class", ["F", "", "C/D/E", "C-D", 0.0, -1.0, float("nan")])
def test_an_unknown_roughness_is_refused(road_class):
    with pytest.raises(ValueError, match=r"Road class|G_d"):
        roughness_coefficient(road_class)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"length_m": 40.0}, "longest wavelength"),
        ({"spacing_m": 0.11}, "at most 0.1 m"),
        ({"shortest_wavelength_m": 50.0}, "not below"),
        ({"length_m": float("inf")}, "finite"),
        ({"length_m": 1e7}, "cells"),
    ],
)
def test_an_impossible_road_is_refused(changes, named):
    with pytest.raises(ValueError, match=named):
        iso8608_road(**{"road_class": "C", "length_m": 100.0, "seed": 0, **changes})
