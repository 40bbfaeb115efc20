import base64
import json
import re

import numpy as np
import pytest
import synthetic_campaign
from test_verdict import table_of

from duralab.campaign import judge, repeatability_in_words
from duralab.data import Channel, IterationTable, Rig, Signals
from duralab.errors import InputError
from duralab.output_files import replace_when_complete, require_outputs
from duralab.recording import open_recording
from duralab.report import write_report
from duralab.report.model_figures import contributions
from duralab.report.series import LARGEST_POINTS, thin_out
from duralab.report.tables import channel_rows, forecast_rows, playback_rows, repeatability_rows
from duralab_proto.v1 import array_pb2, iterator_pb2, rig_pb2

LARGEST_REPORT = 15_000_000


@pytest.fixture(scope="module")
def html(recording_path, tmp_path_factory):
    path = write_report(recording_path, tmp_path_factory.mktemp("report") / "report.html")
    return path.read_text(encoding="utf-8")


def figures_in(html):
    return json.loads(re.search(r'<script type="application/json" id="figures">(.*?)</script>', html, re.DOTALL)[1])


def values(encoded):
    assert encoded["dtype"] == "f4"
    return np.frombuffer(base64.b64decode(encoded["bdata"]), dtype="<f4")


def body(html):
    return html[html.index("<main>") : html.index("</main>")]


def test_every_number_of_the_error_table_stands_in_the_page(html, campaign):
    section = body(html)[body(html).index('id="convergence"') : body(html).index('id="waveforms"')]
    rows = re.findall(r"<tr><th scope=\"row\">\d+.*?</tr>", section, re.DOTALL)
    assert len(rows) == 4
    for row, errors, responses in zip(rows, campaign.errors, campaign.rms_responses, strict=True):
        cells = re.findall(r"<span class=\"(?:best)?\">([\d.]+)</span><br><small>([\d.]+)</small>", row)
        assert cells == [(f"{e:.3f}", f"{r:.3f}") for e, r in zip(errors, responses, strict=True)]


def test_the_summary_marks_each_figure_of_the_best_playback_beside_its_limits(html, campaign):
    best = int(np.argmin(np.mean(campaign.errors**2, axis=1)))
    assert best != 3
    rows = re.findall(r"<tr><th scope=\"row\">.*?</tr>", body(html)[: body(html).index('id="convergence"')], re.DOTALL)
    limits = ((0.0, 0.15), (0.9, 1.1), (0.8, 1.25))
    for i, row in enumerate(rows[:6]):
        figures = (campaign.errors[best, i], campaign.peak_ratios[best, i], campaign.rms_responses[best, i] ** 5)
        cells = re.findall(r"<td class=\"nowrap (bad)?\">([\d.]+)(?: ✗)?</td>", row)
        assert [bool(bad) for bad, _ in cells] == [
            not least <= figure <= most for figure, (least, most) in zip(figures, limits, strict=True)
        ]
        assert [float(text) for _, text in cells] == pytest.approx(figures, abs=6e-3)
        assert ("not accepted" in row) == any(bad for bad, _ in cells)


def test_the_damage_spent_is_in_the_report_and_in_the_printed_table(html, campaign, recording_path):
    spent = np.maximum(1.0, campaign.rms_responses**5)
    section = body(html)[body(html).index(">Damage spent</h3>") : body(html).index('id="model"')]
    rows = re.findall(r"<tr><th scope=\"row\">([^<]+)</th>(.*?)</tr>", section)
    sums = [f"{source}, k = {slope}" for slope in (5, 3, 8) for source in ("identification", "4 playbacks", "sum")]
    assert [title for title, _ in rows] == [*sums, "identification", "1", "2", "3", "4", "all"]
    told = [[float(cell) for cell in re.findall(r"([\d.]+)(?:</b>)?</td>", cells)] for _, cells in rows]
    # An older recording: the identification is a dash, and a sentence says that it is not counted.
    assert told[0] == told[9] == []
    assert "does not state the damage of the identification, so that is not counted." in section
    np.testing.assert_allclose(told[10:], [*spent, spent.sum(axis=0)], atol=0.05)
    for row, slope in zip(told[2:9:3], (5, 3, 8), strict=True):
        expected = np.maximum(1.0, campaign.rms_responses**slope).sum(axis=0)
        # As printed: one decimal, three digits above a hundred.
        np.testing.assert_allclose(row, expected, rtol=0.005, atol=0.051)
    last = next(line for line in str(open_recording(recording_path)).splitlines() if line.startswith("damage spent"))
    np.testing.assert_allclose([float(word) for word in last.split(")")[1].split()[:-1]], spent.sum(axis=0), atol=0.05)


def test_the_summary_tells_what_is_worth_knowing(html):
    assert "<li>Playback 2: The drive of left_lateral would have passed its slew limit.</li>" in body(html)


def test_an_older_recording_without_damage_ratios_shows_a_dash():
    old = iterator_pb2.IterationMetrics(
        iteration=1, channels=[iterator_pb2.ChannelMetrics(channel="left_vertical", relative_rms_error=0.5)]
    )
    table = IterationTable.from_messages([old])
    target = Signals((Channel("left_vertical", "N"),), 100.0, np.ones((1, 4)))
    verdict = judge(table, specification=iterator_pb2.CampaignSpec(), status=None)
    (row,) = channel_rows(table, target, verdict=verdict, slope=5)
    assert (row.damage_ratio, row.energy_outside_band, row.damage_spent) == (("–", ""), ("–", ""), "–")


def test_what_was_predicted_of_a_playback_stands_beside_what_it_missed():
    def metrics(number, *, watched_too=False):
        channels = [
            iterator_pb2.ChannelMetrics(
                channel="left_vertical",
                forecast=iterator_pb2.ChannelForecast(relative_rms_error=0.3, uncertainty=0.04, missed=0.05),
            )
        ]
        if watched_too:
            channels.append(iterator_pb2.ChannelMetrics(channel="beam", watched=True))
        return iterator_pb2.IterationMetrics(iteration=number, channels=channels)

    (row,) = forecast_rows(IterationTable.from_messages([metrics(1, watched_too=True)]))
    assert row.cells == [("0.300 ± 0.040", "0.050"), ("–", "–")]
    table = IterationTable.from_messages([metrics(1), metrics(2)])
    assert table.to_xarray()["prediction_missed"].values.tolist() == [[0.05], [0.05]]
    older = IterationTable.from_messages(
        [iterator_pb2.IterationMetrics(iteration=1, channels=[iterator_pb2.ChannelMetrics(channel="left_vertical")])]
    )
    assert forecast_rows(older) == []
    assert "predicted_error" not in older.to_xarray()


def test_curves_hold_the_metrics_and_the_signals(html, campaign):
    figures = figures_in(html)
    for i, trace in enumerate(figures["error"]["data"]):
        np.testing.assert_allclose(trace["y"], campaign.errors[:, i])
    for i, trace in enumerate(figures["response"]["data"]):
        np.testing.assert_allclose(trace["y"], campaign.rms_responses[:, i])
    target = figures["wave-1"]["data"][0]
    stride = round(target["dx"] * synthetic_campaign.RATE)
    np.testing.assert_allclose(values(target["y"]), campaign.target[1, ::stride], rtol=1e-6, atol=1e-3)


def test_spectrum_integrates_to_the_mean_square_of_the_target(html, campaign):
    trace = figures_in(html)["psd-0"]["data"][0]
    frequency, density = values(trace["x"]).astype(float), values(trace["y"]).astype(float)
    area = np.sum(density) * (frequency[1] - frequency[0])
    assert area == pytest.approx(np.mean(campaign.target[0] ** 2), rel=0.1)


def test_page_needs_nothing_from_outside(html):
    outside = html.replace(html[html.index("<script>") : html.index("</script>")], "")
    assert not re.findall(r"(?:src|href)=[\"'](?!#|data:)", outside)
    assert "default-src 'none'" in html
    assert html.count("plotly.js v") <= 2
    assert len(html) < LARGEST_REPORT


def test_page_says_what_is_needed_to_repeat_it(html, recording_path):
    for wanted in (synthetic_campaign.description().content_hash, "ab" * 32, open_recording(recording_path).sha256):
        assert wanted in body(html)


SENSOR = array_pb2.Sensor(
    serial_number="LC-<4711>",
    sensitivity=2.0,
    sensitivity_unit="mV/V/kN",
    calibration_date="2025-02-03",
    calibration_due="2026-02-03",
    minimum=-3e4,
    maximum=3e4,
    polarity=array_pb2.POLARITY_NEGATIVE,
    warning_level=2e4,
    abort_level=2.5e4,
    drive="left_vertical",
)


def test_sensors_and_calculated_channels_stand_in_report_recording_and_table(html, tmp_path, campaign):
    assert "Sensors</h3>" not in html
    messages = synthetic_campaign.steps(campaign)
    (description,) = (message for message in messages if isinstance(message, rig_pb2.RigDescription))
    description.responses[0].sensor.CopyFrom(SENSOR)
    description.responses[5].calculated.add(channel="left_lateral", weight=0.5)
    path = synthetic_campaign.write(tmp_path / "r.mcap", messages)
    page = write_report(path, tmp_path / "r.html").read_text(encoding="utf-8")
    section = page[page.index("Sensors</h3>") :].split("</table>")[0]
    for cell in (
        *("LC-&lt;4711&gt;", "2 mV/V/kN", "2025-02-03", "2026-02-03", "-30000 … 30000 N", "negative to left_vertical"),
        *("20000 N", "25000 N", "0.5 × left_lateral"),
    ):
        assert f"<td>{cell}</td>" in section
    assert section.count("<tr>") == 3
    rig = Rig.from_message(open_recording(path).rig)
    assert rig.responses[0].to_message() == description.responses[0]
    assert rig.responses[5].to_message() == description.responses[5]
    assert "LC-<4711>" in str(rig)
    assert (
        str(rig).splitlines()[-1].startswith("The calibration of left_vertical (LC-<4711>) is overdue since 2026-02-0")
    )


def test_hostile_texts_stay_texts(tmp_path, campaign):
    messages = synthetic_campaign.steps(campaign, scenario="name: '</script><script>alert(1)</script>'")
    messages[0].target_source = "<img src=x onerror=alert(1)>"
    path = synthetic_campaign.write(tmp_path / "r.mcap", messages)
    html = write_report(path, tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<script>alert" not in html
    assert "<img src=x" not in html


def test_long_recording_stays_small_enough(tmp_path):
    campaign = synthetic_campaign.make(seconds=150.0, iterations=2)
    path = synthetic_campaign.write(tmp_path / "r.mcap", synthetic_campaign.steps(campaign))
    assert write_report(path, tmp_path / "r.html").stat().st_size < LARGEST_REPORT


def test_recording_without_playback_or_model_is_explained_or_reported(tmp_path, campaign):
    messages = synthetic_campaign.steps(campaign)
    path = synthetic_campaign.write(tmp_path / "early.mcap", messages[:4])
    with pytest.raises(InputError, match="holds no playback"):
        write_report(path, tmp_path / "early.html")
    assert list(tmp_path.glob("*.html")) == []
    path = synthetic_campaign.write(tmp_path / "cut.mcap", messages[:8], finish=False)
    html = write_report(path, tmp_path / "cut.html").read_text(encoding="utf-8")
    assert "never finished" in html
    assert "ended early, 1 playback done" in html


def test_the_model_is_shown_with_its_verdicts_warnings_and_uncertainty(html, recording_path):
    section = body(html)[body(html).index('id="model"') : body(html).index('id="actuators"')]
    assert "<li>Nonlinear 6 % of the response at 14 Hz in left longitudinal; noise 1 % over the band.</li>" in section
    assert "<li>Response right_vertical is clipped.</li>" in section
    upper, lower, magnitude = figures_in(html)["frf-0-0"]["data"][:3]
    size = values(magnitude["y"])
    # A deviation of 2 % of the magnitude, twice to either side.
    np.testing.assert_allclose(values(upper["y"]) / size, 1.04, rtol=5e-3)
    np.testing.assert_allclose(values(lower["y"]) / size, 0.96, rtol=5e-3)
    assert open_recording(recording_path).model.warnings == ("Response right_vertical is clipped.",)


def test_envelope_keeps_every_peak():
    samples = np.zeros(LARGEST_POINTS * 30)
    samples[123_457], samples[200_001] = 5.0, -7.0
    curve = thin_out(samples, sample_rate=1000.0, highest_frequency=35.0)
    assert curve.is_envelope
    assert curve.values.size <= LARGEST_POINTS
    assert (curve.values.max(), curve.values.min()) == (5.0, -7.0)
    at = curve.start + curve.step * int(np.argmax(curve.values))
    assert at == pytest.approx(123.457, abs=2 * curve.step)


def test_short_curve_is_sampled_at_its_own_times():
    time = np.arange(4000) / 1000.0
    samples = np.sin(2 * np.pi * 10 * time)
    curve = thin_out(samples, sample_rate=1000.0, highest_frequency=20.0)
    np.testing.assert_array_equal(curve.values, samples[:: round(curve.step * 1000)])
    assert not curve.is_envelope


def test_shares_of_a_noiseless_model_add_up_to_the_whole(recording_path):
    model = open_recording(recording_path).model
    shares = contributions(model, synthetic_campaign.BAND)
    # The synthetic responses hold 7 % of noise power beside what the drives cause; the FRF itself scatters by 2 %.
    np.testing.assert_allclose(np.sum(shares**2, axis=1), 0.93, rtol=0.03)


def test_the_error_is_told_beside_the_noise_floor():
    table = table_of([0.12, 0.2], watched=("c_1",))
    told = iterator_pb2.Repeatability(
        iteration=1,
        playbacks=3,
        channels=[
            iterator_pb2.ChannelRepeatability(channel=name, noise_floor=0.1, relative_rms_error=0.12)
            for name in table.channels
        ],
    )
    rows = repeatability_rows(told, table)
    assert [row.words for row in rows] == ["reproduced to within 1.2 × of the repeatability", "monitored"]
    assert rows[0].noise_floor == "0.1"
    status = iterator_pb2.CampaignStatus(
        iterations=[
            iterator_pb2.IterationMetrics(
                channels=[iterator_pb2.ChannelMetrics(channel=name, watched=name == "c_1") for name in table.channels]
            )
        ],
        repeatability=told,
    )
    assert repeatability_in_words(status).startswith(
        "By 3 playbacks of the drive of playback 1, the target is reproduced to within 1.2 × of the repeatability"
    )
    status.ClearField("repeatability")
    assert repeatability_in_words(status) == ""
    told.channels[0].noise_floor = 0.0
    assert repeatability_rows(told, table)[0].words == "repeats exactly"


def test_best_playback_and_least_errors_are_marked():
    rows = playback_rows(table_of([0.5, 0.4], [0.1, 0.3], [0.4, 0.2]))
    assert [row.is_best for row in rows] == [False, True, False]
    assert [[cell[2] for cell in row.cells] for row in rows] == [[False, False], [True, False], [False, True]]


def test_output_is_whole_or_not_there(tmp_path):
    path = tmp_path / "new" / "x.txt"

    def fail():
        with replace_when_complete(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list(path.parent.iterdir()) == []
    with replace_when_complete(path) as temporary:
        temporary.write_text("whole")
    assert path.read_text() == "whole"


def test_existing_outputs_are_named_and_kept(tmp_path):
    path = tmp_path / "a"
    path.write_text("mine")
    with pytest.raises(InputError, match="would be overwritten; give --replace"):
        require_outputs([path, tmp_path / "b"], replace=False)
    require_outputs([path], replace=True)
