import numpy as np
import pytest
import synthetic_campaign
from fake_lab import describe
from test_campaign_file import changed

from duralab._target import describe_target, make_target, read_target_file, road_inputs
from duralab.campaign_loading import parse_campaign
from duralab.errors import InputError
from duralab.rig import Rig
from duralab.signals import Signals

RIG = Rig.from_message(describe("front_axle"))
VEHICLE = Rig.from_message(describe("predecessor"))
ROAD_ROWS, SPEED_ROWS = [0, 1, 2, 4, 5, 6], [3, 7]


def campaign_with(path="seed", value=1):
    return parse_campaign(changed(path, value), name="x")


def csv_text(*, rate=1000.0, samples=50, names=synthetic_campaign.NAMES, unit="N", seed=1):
    values = np.random.default_rng(seed).standard_normal((len(names), samples)).round(6)
    header = ",".join(["time [s]", *(f"{name} [{unit}]" for name in names)])
    rows = [",".join(f"{x:.9g}" for x in (i / rate, *values[:, i])) for i in range(samples)]
    return "\n".join([header, *rows]), values


def test_road_has_the_length_asked_for_and_starts_on_flat_ground():
    inputs = road_inputs(campaign_with(), vehicle=VEHICLE)
    assert inputs.samples.shape == (8, 10_000)
    road, speed = inputs.samples[ROAD_ROWS], inputs.samples[SPEED_ROWS]
    assert np.abs(road[:, [0, -1]]).max() == 0.0
    assert np.all(speed == 15.0)
    assert 0.001 < np.std(inputs.samples[0]) < 0.05
    assert inputs.samples.flags.c_contiguous


def test_same_seed_same_road_other_seed_another():
    first = road_inputs(campaign_with(), vehicle=VEHICLE).samples
    again = road_inputs(campaign_with(), vehicle=VEHICLE).samples
    other = road_inputs(campaign_with("target.road.seed", 3), vehicle=VEHICLE).samples
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_vehicle_s_rear_axle_gets_the_road_of_the_front_one_later():
    message = describe("predecessor")
    for channel in list(message.drives):
        message.drives.add(name=f"rear_{channel.name}", unit=channel.unit, minimum=-50.0, maximum=50.0)
    whole = Rig.from_message(message)
    inputs = road_inputs(campaign_with(), vehicle=whole)
    assert inputs.names == tuple(channel.name for channel in whole.drives)
    assert inputs.samples.shape == (16, 10_000)
    assert np.all(inputs.samples[[3, 7, 11, 15]] == 15.0)
    # 2.8 m at 15 m/s are 186 2/3 samples: between the front's road 186 and 187 samples before.
    front, rear = inputs.samples[0], inputs.samples[8]
    later = np.interp(np.arange(10_000) - 2.8 / 15.0 * 1000.0, np.arange(10_000), front)
    assert np.abs(rear - later)[1500:-1100].max() < 0.02 * np.std(front)
    # The front axle alone rolls over the same road.
    alone = road_inputs(campaign_with(), vehicle=VEHICLE).samples
    np.testing.assert_allclose(inputs.samples[[1, 2]][:, 1100:-1100], alone[[1, 2]][:, 1100:-1100], atol=1e-12)


def test_potholes_deepen_the_road():
    holes = {"count": 3, "depth": [0.05, 0.05], "length": [0.8, 1.0]}
    flat = road_inputs(campaign_with(), vehicle=VEHICLE).samples
    rough = road_inputs(campaign_with("target.road.potholes", holes), vehicle=VEHICLE).samples
    # The common mean height is taken off, so each hole lowers its side and raises the other a little.
    assert np.min((rough - flat)[[0, 4]]) < -0.03


def test_missing_road_file_is_named_with_its_place():
    road = {"opencrg": {"path": "none.crg", "duration": 10.0}, "vehicle": "predecessor"}
    with pytest.raises(InputError, match=r"target\.opencrg\.path is 'none\.crg'"):
        road_inputs(campaign_with("target", road), vehicle=VEHICLE)


def test_file_that_is_no_road_is_refused(tmp_path):
    path = tmp_path / "x.crg"
    path.write_bytes(b"no road at all")
    road = {"opencrg": {"path": str(path), "duration": 10.0}, "vehicle": "predecessor"}
    with pytest.raises(InputError, match=r"target\.opencrg: x\.crg"):
        road_inputs(campaign_with("target", road), vehicle=VEHICLE)


def test_target_of_another_sample_rate_is_refused():
    slow = describe("predecessor")
    slow.sample_rate = 500.0
    with pytest.raises(InputError, match="500 Hz and rig 'front_axle' at 1000 Hz"):
        make_target(campaign_with(), rig=RIG, vehicle=Rig.from_message(slow), play=lambda inputs: inputs)


def test_responses_are_put_into_the_order_of_the_rig():
    def play(inputs):
        order = [5, 4, 3, 2, 1, 0]
        samples = np.arange(6.0)[order, None] * np.ones((6, 10))
        return Signals(tuple(RIG.responses[i] for i in order), 1000.0, samples)

    target = make_target(campaign_with(), rig=RIG, vehicle=VEHICLE, play=play)
    assert target.names == synthetic_campaign.NAMES
    np.testing.assert_array_equal(target.samples[:, 0], np.arange(6.0))


def test_csv_target_is_read_in_any_column_order(tmp_path):
    text, values = csv_text(names=synthetic_campaign.NAMES[::-1])
    path = tmp_path / "target.csv"
    path.write_text(text)
    target = read_target_file(path, rig=RIG)
    np.testing.assert_allclose(target.samples, values[::-1])
    campaign = campaign_with("target", {"file": str(path)})
    np.testing.assert_array_equal(make_target(campaign, rig=RIG, vehicle=None, play=None).samples, target.samples)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "0 samples"),
        ("time [s],left_vertical [N]\n", "0 samples"),
        (csv_text(rate=500.0)[0], "sampled at 500 Hz; the rig plays 1000 Hz only"),
        (csv_text(unit="kN")[0], "in kN; it must be in N"),
        (csv_text(names=synthetic_campaign.NAMES[:4])[0], "lacks right_lateral, right_longitudinal"),
        (csv_text()[0].replace("time [s]", "t [s]"), "starts with 't [s]'"),
        (csv_text()[0].replace("left_lateral [N]", "left_lateral"), "must name a unit"),
        (csv_text()[0].replace("0.003,", "0.0035,"), "must be equal"),
        (csv_text()[0].replace("0.003,", "0.003,nan,", 1), "numbers are needed|finite"),
        (csv_text()[0].replace("0.003,", "x,", 1), "line 5"),
    ],
)
def test_csv_target_that_does_not_fit_is_refused(tmp_path, text, part):
    path = tmp_path / "target.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=part.replace("[", r"\[")) as caught:
        read_target_file(path, rig=RIG)
    assert caught.value.message.startswith("target")


def test_value_that_is_not_finite_is_refused(tmp_path):
    path = tmp_path / "target.csv"
    lines = csv_text()[0].splitlines()
    lines[4] = lines[4].rsplit(",", 1)[0] + ",inf"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="line 5: right_longitudinal \\[N\\] is inf"):
        read_target_file(path, rig=RIG)


def test_source_is_described_in_words():
    assert describe_target(campaign_with().target).startswith("ISO 8608 road of class C/D (seed 2), 10 s driven by")
