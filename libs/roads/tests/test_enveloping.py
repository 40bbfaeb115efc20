import numpy as np
import pytest

from duralab_roads import EFFECTIVE_INPUTS, Road, effective_inputs, iso8608_road

COLUMNS = np.array([-0.9, -0.75, -0.6, 0.6, 0.75, 0.9])
DRIVE = {
    "speed": 15.0,
    "sample_rate": 1000.0,
    "samples": 6001,
    "track_width": 1.5,
    "tyre_radius": 0.32,
    "contact_length": 0.12,
    "contact_width": 0.2,
    "lead_in_seconds": 0.5,
}
TIME = np.arange(DRIVE["samples"]) / DRIVE["sample_rate"]
U = DRIVE["speed"] * TIME
SETTLED = slice(600, -600)


def _road(height_at, *, length=95.0, spacing=0.01):
    along = spacing * np.arange(round(length / spacing) + 1)
    return Road(spacing, COLUMNS, np.broadcast_to(height_at(along[:, None], COLUMNS), (along.size, COLUMNS.size)))


def _inputs(road, **changes):
    return dict(zip(EFFECTIVE_INPUTS, effective_inputs(road, **{**DRIVE, **changes}), strict=True))


def _amplitude(samples, wavelength):
    phase = 2 * np.pi * U[SETTLED] / wavelength
    design = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    return np.linalg.lstsq(design, samples[SETTLED], rcond=None)[0][:2]


@pytest.mark.parametrize("wavelength", [5.0, 15.0])
def test_a_long_wave_passes_with_gain_one_and_the_slope_of_a_sine(wavelength):
    inputs = _inputs(_road(lambda u, v: 0.01 * np.sin(2 * np.pi * u / wavelength) + 0 * v))
    for side in ("left", "right"):
        assert _amplitude(inputs[f"{side}_height"], wavelength) == pytest.approx([0, 0.01], abs=4e-5)
        assert _amplitude(inputs[f"{side}_slope"], wavelength) == pytest.approx(
            [2 * np.pi * 0.01 / wavelength, 0], rel=4e-3, abs=4e-5
        )
        assert np.abs(inputs[f"{side}_camber"]).max() < 1e-9


def test_the_patch_averages_a_short_wave_as_a_box_does():
    wavelength, small = 0.3, 1e-4  # too flat for the disk to bridge
    inputs = _inputs(_road(lambda u, v: small * np.sin(2 * np.pi * u / wavelength) + 0 * v, spacing=0.005))
    assert _amplitude(inputs["left_height"], wavelength)[1] == pytest.approx(small * np.sinc(0.12 / 0.3), rel=0.01)


def test_slope_is_the_derivative_of_height_through_the_fades_too():
    road = iso8608_road(road_class="D", length_m=95, seed=3, lateral_positions=COLUMNS)
    inputs = _inputs(road)
    for side in ("left", "right"):
        height, slope = inputs[f"{side}_height"], inputs[f"{side}_slope"]
        fourth_order = (height[:-4] - 8 * height[1:-3] + 8 * height[3:-1] - height[4:]) / (12 * 0.015)
        difference = fourth_order - slope[2:-2]
        assert difference.std() < 0.005 * slope.std()
        assert np.abs(difference).max() < 0.05 * slope.std()


def test_a_disk_meets_a_step_where_geometry_says():
    step, radius = 0.03, DRIVE["tyre_radius"]
    inputs = _inputs(_road(lambda u, v: np.where(u >= 45.0, step, 0.0) + 0 * v, spacing=0.005), contact_length=0.01)
    height = inputs["left_height"] - inputs["left_height"][1000]
    before = 45.0 - U
    reach = np.sqrt(2 * radius * step - step**2)
    climbing = (before > 0.02) & (before < reach - 0.02)
    expected = step - radius + np.sqrt(radius**2 - before[climbing] ** 2)
    np.testing.assert_allclose(height[climbing], expected, atol=6e-4)
    assert np.abs(height[SETTLED][before[SETTLED] > reach + 0.1]).max() < 1e-3 * step + 2e-5
    assert np.abs(height[SETTLED][before[SETTLED] < -0.1] - step).max() < 1e-3 * step + 2e-5


def test_a_step_is_never_left_behind_or_overshot():
    step = 0.03
    inputs = _inputs(_road(lambda u, v: np.where((u >= 40) & (u < 50), step, 0.0) + 0 * v))
    height = inputs["right_height"] - inputs["right_height"][1000]
    assert height[SETTLED].min() > -0.01 * step
    assert height[SETTLED].max() < 1.01 * step


def test_a_banked_road_gives_its_camber_positive_when_higher_on_the_left():
    inputs = _inputs(_road(lambda u, v: 0.02 * v + 0 * u))
    np.testing.assert_allclose(inputs["left_camber"][SETTLED], 0.02, atol=1e-12)
    np.testing.assert_allclose(inputs["right_camber"][SETTLED], 0.02, atol=1e-12)
    np.testing.assert_allclose(inputs["left_height"][SETTLED], 0.015, atol=1e-12)
    np.testing.assert_allclose(inputs["right_height"][SETTLED], -0.015, atol=1e-12)


def test_the_left_wheel_drives_on_the_left():
    inputs = _inputs(_road(lambda u, v: np.where(v > 0, 0.01 * np.sin(u), 0.0)))
    assert inputs["left_height"].std() > 100 * inputs["right_slope"].std()


def test_a_shifted_road_gives_shifted_inputs():
    road = iso8608_road(road_class="D", length_m=120, seed=8, spacing_m=0.015, lateral_positions=COLUMNS)
    shifted = Road(0.015, COLUMNS, road.elevation[200:])
    first = effective_inputs(road, **DRIVE)[:, 800:-600]
    second = effective_inputs(shifted, **DRIVE)[:, 600:-800]
    difference = first - second
    # The common mean height belongs to the stretch that is driven.
    difference -= difference.mean(axis=1, keepdims=True)
    assert np.abs(difference).max() < 1e-12


@pytest.mark.parametrize("wheelbase", [2.8, 2.805, 3.14159])
def test_a_following_axle_gets_the_same_road_later(wheelbase):
    # Smooth, so that interpolation between samples is exact enough to compare a delay that is no whole number of them.
    road = _road(lambda u, v: 0.01 * np.sin(2 * np.pi * u / 7.0) + 0.002 * v * np.cos(2 * np.pi * u / 3.0))
    inputs = effective_inputs(road, **DRIVE, axle_distances=(0.0, wheelbase))
    assert inputs.shape == (12, DRIVE["samples"])
    later = np.array([np.interp(TIME - wheelbase / DRIVE["speed"], TIME, row) for row in inputs[:6]])
    assert np.abs(inputs[6:] - later)[:, 800:-600].max() < 2e-6
    assert np.all(inputs[:, [0, -1]] == 0)
    # One axle alone gets what it gets with another one behind it, but for the mean height of all that is driven.
    alone = effective_inputs(road, **DRIVE)
    np.testing.assert_allclose(inputs[[2, 5]], alone[[2, 5]], atol=1e-15)
    difference = (inputs[:6] - alone)[[0, 3]][:, SETTLED]
    assert np.ptp(difference) < 1e-15


def test_an_axle_that_never_reaches_the_road_stays_on_flat_ground():
    inputs = effective_inputs(_road(lambda u, v: np.sin(u) + 0 * v), **DRIVE, axle_distances=(0.0, 200.0))
    assert np.ptp(inputs[6][SETTLED]) < 1e-12


@pytest.mark.parametrize("distances", [(), (0.0, -1.0), (0.0, float("nan"))])
def test_an_impossible_place_of_an_axle_is_refused(distances):
    with pytest.raises(ValueError, match="axle_distances is"):
        effective_inputs(_road(lambda u, v: 0 * u + 0 * v), **DRIVE, axle_distances=distances)


@pytest.mark.parametrize("offset", [0.0, 2.1])
def test_a_rig_at_rest_is_not_kicked(offset):
    road = iso8608_road(road_class="D", length_m=95, seed=1, lateral_positions=COLUMNS)
    inputs = effective_inputs(Road(road.spacing, COLUMNS, road.elevation + offset), **DRIVE)
    assert np.all(inputs[:, [0, -1]] == 0)
    # Velocity and acceleration begin at 0: the first millisecond moves less than a micrometre.
    assert np.abs(inputs[[0, 3], 1]).max() < 1e-6
    assert np.abs(np.diff(inputs[[0, 3]], n=2)[:, 0]).max() < 1e-6
    np.testing.assert_allclose(inputs, effective_inputs(road, **DRIVE), atol=1e-12)


@pytest.mark.parametrize("sample_rate", [200.0, 250.0])
def test_waves_above_nyquist_are_not_folded_back(sample_rate):
    # 150 Hz at 15 m/s, too flat for the disk to bridge; a patch of 2 cm lets it pass.
    road = _road(lambda u, v: 1e-4 * np.sin(2 * np.pi * u / 0.1) + 0 * v, spacing=0.0025)
    passed = effective_inputs(road, **{**DRIVE, "contact_length": 0.02})
    folded = effective_inputs(
        road, **{**DRIVE, "contact_length": 0.02, "sample_rate": sample_rate, "samples": round(6 * sample_rate)}
    )
    settled = slice(round(0.6 * sample_rate), -round(0.6 * sample_rate))
    assert passed[0][SETTLED].std() == pytest.approx(1e-4 / np.sqrt(2), rel=0.1)
    assert folded[0][settled].std() < 3e-4 * passed[0][SETTLED].std()
    assert folded[1][settled].std() < 3e-4 * passed[1][SETTLED].std()


def test_holes_in_the_measurement_matter_only_in_a_tyres_way():
    columns = np.concatenate([[-1.5], COLUMNS[:3], [0.0], COLUMNS[3:]])
    heights = np.zeros((9501, columns.size))
    heights[100:200, [0, 4]] = np.nan  # beside the outermost disks, which roll exactly on a column
    drive = {**DRIVE, "contact_width": 0.3}
    assert np.all(effective_inputs(Road(0.01, columns, heights), **drive) == 0)
    heights[300, 2] = np.nan
    with pytest.raises(ValueError, match=r"NaN\) at u = 3.000 m"):
        effective_inputs(Road(0.01, columns, heights), **drive)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"speed": 0.0}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"sample_rate": -1.0}, "sample_rate"),
        ({"samples": 8000}, "repeat_mirrored"),
        ({"samples": 800}, "lead-in"),
        ({"lead_in_seconds": 0.0}, "lead_in_seconds"),
        ({"track_width": 1.9}, "narrower track"),
        ({"contact_length": 0.7}, "contact_length"),
    ],
)
def test_an_impossible_drive_is_refused_by_name(changes, named):
    with pytest.raises(ValueError, match=named):
        _inputs(_road(lambda u, v: 0 * u + 0 * v), **changes)
