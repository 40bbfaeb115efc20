import json
import re

import numpy as np
import pytest
import synthetic_campaign

import duralab
from duralab.errors import InputError
from duralab.report import write_comparison
from duralab_proto.v1 import iterator_pb2


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """The same target with a smaller gain, and with a name of its own."""
    made = synthetic_campaign.make(seconds=12.0, iterations=6, gain=0.4)
    messages = synthetic_campaign.steps(made)
    messages[0].id = "slow"
    messages[0].update.iteration_gain.CopyFrom(synthetic_campaign.to_array(np.full(6, 0.4)))
    return synthetic_campaign.write(tmp_path_factory.mktemp("slow") / "recording.mcap", messages), made


def test_each_channel_of_each_recording_has_its_figures(recording_path, campaign, slow):
    path, other = slow
    compared = duralab.compare(recording_path, duralab.open_recording(path))
    assert compared.names == ("demo", "slow")
    assert compared.channels == synthetic_campaign.NAMES
    for i, channel in enumerate(compared.channels):
        for row, made in zip(compared.of_channel(channel), (campaign, other), strict=True):
            best = int(np.argmin(np.mean(made.errors**2, axis=1)))
            assert row.first_error == pytest.approx(made.errors[0, i])
            assert row.relative_rms_error == pytest.approx(made.errors[best, i])
            assert row.peak_ratio == pytest.approx(made.peak_ratios[best, i])
            assert row.damage_ratio == pytest.approx([made.rms_responses[best, i] ** k for k in (3, 5, 8)])
            spent = [np.maximum(1.0, made.rms_responses[:, i] ** k).sum() for k in (3, 5, 8)]
            assert row.damage_spent == pytest.approx(spent)
            assert np.isnan(row.identification_damage).all()


def test_only_what_differs_is_told_and_the_same_target_is_known(recording_path, slow):
    compared = duralab.compare(recording_path, slow[0])
    assert compared.same_target
    told = {difference.setting: difference.values for difference in compared.differences}
    assert told == {"update.iteration_gain": ("0.7", "0.4"), "stop.iterations": ("4", "6")}


def test_another_target_another_kind_and_another_rig_are_told(recording_path, tmp_path, campaign):
    messages = synthetic_campaign.steps(campaign)
    messages[0].target.sample_rate = 999.0
    messages[0].update.kind = iterator_pb2.UPDATE_KIND_SECANT
    messages[1].content_hash = "beef" * 16
    path = synthetic_campaign.write(tmp_path / "r.mcap", messages)
    compared = duralab.compare(recording_path, path)
    told = {difference.setting: difference.values for difference in compared.differences}
    assert not compared.same_target
    assert told["update.kind"] == ("adaptive modelling", "secant")
    assert "beefbeef" in told["rig.content"][1]


def test_names_that_come_twice_are_told_apart(recording_path, tmp_path, campaign):
    path = synthetic_campaign.write(tmp_path / "again.mcap", synthetic_campaign.steps(campaign))
    assert len(set(duralab.compare(recording_path, path, path).names)) == 3


def test_text_document_and_dataset_hold_the_same_numbers(recording_path, slow):
    compared = duralab.compare(recording_path, slow[0])
    error = compared.rows[1].relative_rms_error
    assert f"{error:.3f}" in str(compared)
    assert f">{error:.3f}</td>" in compared._repr_html_()
    assert "demo, slow" in repr(compared)
    document = json.loads(json.dumps(compared.to_document(), allow_nan=False))
    assert document["channels"][1]["relative_rms_error"] == error
    assert document["differences"][0]["values"]["slow"] in ("0.4", "6")
    dataset = compared.to_xarray()
    assert float(dataset.relative_rms_error.sel(recording="slow", channel="left_vertical")) == error
    assert dataset.damage_ratio.dims == ("recording", "channel", "slope")


def test_what_cannot_be_compared_is_refused(recording_path, tmp_path, campaign):
    with pytest.raises(InputError, match="two or more"):
        duralab.compare(recording_path)
    messages = synthetic_campaign.steps(campaign)
    early = synthetic_campaign.write(tmp_path / "early.mcap", messages[:4])
    with pytest.raises(InputError, match="holds no playback"):
        duralab.compare(recording_path, early)
    for message in messages:
        for channel in getattr(getattr(message, "metrics", None), "channels", ()):
            channel.channel = f"other_{channel.channel}"
    other = synthetic_campaign.write(tmp_path / "other.mcap", messages)
    with pytest.raises(InputError, match="no response channel in common"):
        duralab.compare(recording_path, other)


def test_the_page_overlays_every_recording_and_asks_for_nothing(recording_path, slow, tmp_path):
    compared = duralab.compare(recording_path, slow[0])
    html = write_comparison(tmp_path / "c.html", compared).read_text(encoding="utf-8")
    figures = json.loads(re.search(r'<script type="application/json" id="figures">(.*?)</script>', html, re.DOTALL)[1])
    assert [trace["name"] for trace in figures["overall"]["data"]] == ["demo", "slow"]
    assert len(figures["overall"]["data"][1]["y"]) == 6
    for kind in ("zoom", "psd", "pairs", "crossings", "times"):
        assert [trace["name"] for trace in figures[f"{kind}-0"]["data"]] == ["target", "demo", "slow"]
    assert len({trace["line"]["color"] for trace in figures["psd-0"]["data"]}) == 3
    assert [trace["name"] for trace in figures["damage-5"]["data"]] == ["demo", "slow"]
    assert sum(name.startswith("frf-") for name in figures) == 36
    outside = html.replace(html[html.index("<script>") : html.index("</script>")], "")
    assert not re.findall(r"(?:src|href)=[\"'](?!#|data:)", outside)
    for plot in re.findall(r'data-kind="([^"]*)" data-value="([^"]*)"', html):
        assert "-".join(part for part in plot if part) in figures
