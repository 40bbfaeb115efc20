import re

import nptdms
import numpy as np
import pytest
import synthetic_campaign
from fake_lab import describe
from test_campaign_file import changed

from duralab.campaign import parse_campaign
from duralab.data import Rig, Signals, StepRecord
from duralab.errors import InputError
from duralab.lab.campaign_starting import made_target
from duralab.lab.client import FOREVER
from duralab.report.provenance import target_step_rows
from duralab.target import describe_target, make_target, read_target_file
from duralab.target.making import road_inputs
from duralab_proto.v1 import iterator_pb2

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

    target = make_target(campaign_with(), rig=RIG, vehicle=VEHICLE, play=play).signals
    assert target.names == synthetic_campaign.NAMES
    np.testing.assert_array_equal(target.samples[:, 0], np.arange(6.0))


def from_file(path, **target):
    campaign = campaign_with("target", {"file": str(path)} | target)
    return make_target(campaign, rig=RIG, vehicle=None, play=None)


def test_csv_target_is_read_in_any_column_order(tmp_path):
    text, values = csv_text(names=synthetic_campaign.NAMES[::-1])
    path = tmp_path / "target.csv"
    path.write_text(text)
    target = read_target_file(path, rig=RIG, channels={}).signals
    np.testing.assert_allclose(target.samples, values[::-1])
    edited = from_file(path)
    np.testing.assert_array_equal(edited.signals.samples, target.samples)
    assert edited.signals.names == synthetic_campaign.NAMES
    assert [record.name for record in edited.records] == ["read_file"]


MAP = {
    "left_vertical": {"from": "FZ_FL", "unit": "kN", "scale": -1},
    "left_lateral": "FY_FL",
    "left_longitudinal": {"from": "FX_FL", "unit": "lbf"},
    "right_vertical": {"from": "FZ_FR", "unit": "kN", "scale": -1},
    "right_lateral": "FY_FR",
}


def test_channels_of_a_file_get_the_names_units_and_signs_of_the_rig(tmp_path):
    text, values = csv_text(names=("FX_FL", "FY_FL", "FZ_FL", "FY_FR", "FZ_FR", "spare", "right_longitudinal"))
    text = text.replace("FY_FL [N]", "FY_FL [daN]")
    path = tmp_path / "road.csv"
    path.write_text(text)
    samples = from_file(path, channels=MAP).signals.samples
    # The pound-force is 4.4482216152605 N by definition.
    expected = [-1e3 * values[2], 10.0 * values[1], 4.4482216152605 * values[0], -1e3 * values[4], values[3], values[6]]
    np.testing.assert_allclose(samples, expected, rtol=1e-12)


def test_what_the_reader_of_a_file_left_out_is_in_the_record_of_reading_it(tmp_path):
    path = tmp_path / "road.tdms"
    step = {"wf_increment": 0.001, "unit_string": "N"}
    rows = [*((name, np.arange(5.0)) for name in synthetic_campaign.NAMES), ("gear", np.ones(5, dtype=bool))]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("g", name, row, properties=step) for name, row in rows])
    sentence = "Channels that are not real numbers are left out: gear."
    (record,) = from_file(path).records
    assert record.finding.count("left out") == 1
    assert record.finding.endswith(f". {sentence}")
    assert StepRecord.from_message(record.to_message()) == record
    (row,) = target_step_rows(iterator_pb2.CampaignSpec(target_steps=[record.to_message()]))
    assert row.finding == f"see the table below. {sentence}".rstrip(".")
    told, plan = [], campaign_with("target", {"file": str(path)})
    made_target(None, plan, rig=RIG, id="x", on_progress=told.append, deadline=FOREVER)
    assert [(progress.activity, progress.lasting) for progress in told] == [(sentence, True)]
    with pytest.raises(InputError, match=rf"lacks gear for left_lateral; .* {re.escape(sentence)}$"):
        from_file(path, channels={"left_lateral": "gear"})


CALCULATED = [
    {"name": "axle_vertical", "kind": "force", "sum": ["FZ_FL", "FZ_FR"]},
    {"name": "unlike", "kind": "force", "weights": {"FY_FL": 0.5, "FY_FR": "-0.5"}},
]


def test_a_response_follows_a_channel_that_is_calculated_from_those_of_the_file(tmp_path):
    text, values = csv_text(names=("FX_FL", "FY_FL", "FZ_FL", "FY_FR", "FZ_FR", "spare", "right_longitudinal"))
    path = tmp_path / "road.csv"
    path.write_text(text.replace("FZ_FL [N]", "FZ_FL [kN]"))
    channels = MAP | {"left_vertical": "axle_vertical", "right_lateral": {"from": "unlike", "scale": -1}}
    made = from_file(path, channels=channels, calculated=CALCULATED)
    np.testing.assert_allclose(made.signals.samples[0], 1e3 * values[2] + values[4], rtol=1e-12)
    np.testing.assert_allclose(made.signals.samples[4], 0.5 * (values[3] - values[1]), atol=1e-12)
    assert "sum: [FZ_FL, FZ_FR]" in made.records[0].settings


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sum": ["FZ_FL", "FZ"]}, "target.calculated: axle_vertical is calculated from FZ; there are FX_FL"),
        ({"kind": "moment"}, "target.calculated: axle_vertical is a moment in 'N*m': FZ_FL is in 'N', which cannot"),
        ({"name": "spare"}, "target.calculated: spare is calculated, and exists already; give it another name."),
    ],
)
def test_a_calculated_channel_that_does_not_fit_the_file_is_named(tmp_path, change, sentence):
    path = tmp_path / "road.csv"
    path.write_text(csv_text(names=("FX_FL", "FZ_FL", "FZ_FR", "spare"))[0])
    with pytest.raises(InputError) as caught:
        from_file(path, calculated=[CALCULATED[0] | change])
    assert caught.value.message.startswith(sentence)


def test_calculated_channels_of_a_road_are_refused():
    with pytest.raises(InputError, match="has calculated channels but no file; let the rig calculate responses"):
        campaign_with("target.calculated", CALCULATED)


def test_what_was_done_to_each_channel_of_the_file_is_recorded(tmp_path):
    text, values = csv_text(names=("FX_FL", "FY_FL", "FZ_FL", "FY_FR", "FZ_FR", "spare", "right_longitudinal"))
    path = tmp_path / "road.csv"
    path.write_text(text.replace("FY_FL [N]", "FY_FL [daN]"))
    record = StepRecord.from_message(from_file(path, channels=MAP).records[0].to_message())
    assert record.name == "read_file"
    assert "from: FZ_FL" in record.settings
    read = {channel.channel: channel.source for channel in record.channels}
    peaks, levels = np.abs(values).max(axis=1), np.sqrt(np.mean(values**2, axis=1))
    for response, row, unit, stated, factor in (
        ("left_vertical", 2, "N", "kN", -1e3),
        ("left_lateral", 1, "daN", "", 10.0),
        ("left_longitudinal", 0, "N", "lbf", 4.4482216152605),
        ("right_longitudinal", 6, "N", "", 1.0),
    ):
        source = read[response]
        assert (source.source_unit, source.stated_unit) == (unit, stated)
        assert source.factor == pytest.approx(factor, rel=1e-12)
        assert (source.peak_before, source.rms_before) == pytest.approx((peaks[row], levels[row]))
        assert (source.peak_after, source.rms_after) == pytest.approx(
            (abs(factor) * peaks[row], abs(factor) * levels[row])
        )
    for words in (
        "left_vertical: FZ_FL in kN (stated, the file says N) × -1000 (sign turned), peak ",
        "FY_FL in daN × 10",
    ):
        assert words in str(record)


def test_a_watched_response_without_a_channel_is_recorded_as_silent(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text(csv_text(names=synthetic_campaign.NAMES[:5])[0])
    target = read_target_file(path, rig=RIG, channels={}, watched=synthetic_campaign.NAMES[5:])
    assert "right_longitudinal: silent, the file has no channel for it" in str(target.records[0])
    assert StepRecord.from_message(target.records[0].to_message()) == target.records[0]


@pytest.mark.parametrize(
    ("channels", "parts"),
    [
        (
            MAP | {"left_lateral": "FY_FLL"},
            ["lacks FY_FLL for left_lateral", "it has FX_FL", "did you mean 'FY_FL'?"],
        ),
        (MAP | {"middle": "FY_FL"}, ["unknown response middle", "left_vertical"]),
        (MAP | {"left_lateral": {"from": "FY_FL", "unit": "mm"}}, ["target.channels.left_lateral", "'mm'", "needs N"]),
        ({}, ["lacks left_vertical, left_lateral", "say in target.channels which is which"]),
    ],
)
def test_a_channel_that_does_not_fit_is_named(tmp_path, channels, parts):
    path = tmp_path / "road.csv"
    path.write_text(csv_text(names=("FX_FL", "FY_FL", "FZ_FL", "FY_FR", "FZ_FR", "right_longitudinal"))[0])
    with pytest.raises(InputError) as caught:
        from_file(path, channels=channels)
    for part in parts:
        assert part in caught.value.message
    assert caught.value.field.startswith("target.channels")


def test_a_target_of_another_rate_is_resampled_when_it_says_so(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text(csv_text(rate=500.0, samples=400)[0])
    with pytest.raises(InputError, match=r"at 500 Hz; rig 'front_axle' plays 1000 Hz .*'resample: {rate: 1000}'"):
        from_file(path)
    edited = from_file(path, edit=[{"cut": {"to": 0.6}}, {"resample": {"rate": 1000}}])
    assert edited.signals.samples.shape == (6, 600)
    assert edited.signals.sample_rate == RIG.sample_rate
    assert [record.name for record in edited.records] == ["read_file", "cut", "resample"]


def test_a_target_longer_than_the_rig_plays_is_refused_until_it_is_cut(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text(csv_text(samples=400)[0])
    message = describe("front_axle")
    message.longest_drive_seconds = 0.3
    short = Rig.from_message(message)
    with pytest.raises(InputError, match=r"target lasts 0\.4 s; rig 'front_axle' plays 0\.3 s at most"):
        make_target(campaign_with("target", {"file": str(path)}), rig=short, vehicle=None, play=None)
    cut = campaign_with("target", {"file": str(path), "edit": [{"cut": {"to": 0.25}}]})
    assert make_target(cut, rig=short, vehicle=None, play=None).signals.duration == 0.25


def test_a_road_is_edited_as_a_file_is():
    def play(inputs):
        return Signals(RIG.responses, 1000.0, np.ones((6, inputs.samples.shape[1])))

    campaign = campaign_with("target.edit", [{"cut": {"from": 1, "to": 4}}])
    edited = make_target(campaign, rig=RIG, vehicle=VEHICLE, play=play)
    assert edited.signals.samples.shape == (6, 3000)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "empty"),
        ("time [s],left_vertical [N]\n", "samples"),
        (csv_text(unit="kg")[0], "in 'kg', none of N|left_vertical is in 'kg'"),
        (csv_text()[0].replace("time [s]", "t [s]"), "'t \\[s\\]'"),
        (csv_text()[0].replace("left_lateral [N]", "left_lateral"), "names no unit"),
        (csv_text()[0].replace("0.003,", "0.0035,"), "time steps"),
        (csv_text()[0].replace("0.003,", "x,", 1), "line 5"),
    ],
)
def test_csv_target_that_does_not_fit_is_refused(tmp_path, text, part):
    path = tmp_path / "target.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=part) as caught:
        from_file(path)
    assert caught.value.message.startswith("target")
    assert "\n" not in caught.value.message


def test_source_is_described_in_words():
    assert describe_target(campaign_with().target).startswith("ISO 8608 road of class C/D (seed 2), 10 s driven by")
    with_steps = campaign_with("target", {"file": "a/road.rsp", "edit": ["remove_mean"]})
    assert describe_target(with_steps.target) == "file road.rsp"
