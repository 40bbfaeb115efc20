"""Levels of an identification by the pulses of a pre-test: how far each response moves for one unit of a drive."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from duralab import Channel, Signals
from duralab.campaign import campaign_text, levels_by_pulses, parse_campaign
from duralab.data import PreTest, Rig
from duralab.errors import InputError

BAND = (0.5, 35.0)
#: A stiff drive and a soft one: newtons of both responses for a metre of each drive.
GAIN = np.array([[4e7, 2e4], [-1e6, -5e4]])
AMPLITUDE = np.array([0.0005, -0.001])
RIG = Rig(
    name="pair",
    specimen="",
    engine="",
    version="1",
    sample_rate=1000.0,
    drives=tuple(
        Channel(name, "m", minimum=-0.1, maximum=0.1, slew_limit=limit)
        for name, limit in (("stiff", 2.0), ("soft", 0.0))
    ),
    responses=tuple(Channel(name, "N", minimum=-1e5, maximum=1e5) for name in ("front", "rear")),
    longest_drive_seconds=600.0,
    static_response=np.zeros(2),
    content_hash="",
)
PRE_TEST = PreTest(
    id="pair-pre-test",
    rig="pair",
    passed=True,
    findings=(),
    expectations=(),
    drives=RIG.drives,
    responses=RIG.responses,
    amplitude=AMPLITUDE,
    offset=np.zeros(2),
    noise=np.zeros(2),
    peak=np.abs(GAIN * AMPLITUDE),
    lag=np.zeros(2),
    gain=np.ones(2),
)


def target(*amplitudes, offset=0.0, frequency=5.0):
    time = np.arange(20_000) / RIG.sample_rate
    rows = np.array(amplitudes)[:, None] * np.sin(2.0 * np.pi * frequency * time) + offset
    return Signals(RIG.responses, RIG.sample_rate, rows)


def levels(of=None, *, pre_test=PRE_TEST, rig=RIG):
    return levels_by_pulses(pre_test, rig=rig, target=of or target(1000.0, 400.0), band=BAND)


def test_the_response_that_a_drive_moves_most_gets_half_the_rms_of_its_target():
    found = levels()
    assert found.pre_test == "pair-pre-test"
    wanted = np.array([1000.0, 400.0]) / np.sqrt(2.0)
    share = np.abs(GAIN) * list(found.rms.values()) / wanted[:, None]
    # Rounded down to two digits.
    assert np.all(share.max(axis=0) <= 0.5)
    assert np.all(share.max(axis=0) > 0.9 * 0.5)
    assert share.argmax(axis=0).tolist() == [0, 1]


def test_only_what_the_target_does_in_the_band_counts():
    assert levels(target(1000.0, 400.0, offset=5000.0)).rms == levels().rms
    outside = target(9e4, 9e4, frequency=80.0).samples
    both = target(1000.0, 400.0)
    assert levels(replace(both, samples=both.samples + outside)).rms == levels().rms


def test_a_level_is_a_tenth_of_the_limit_at_most_and_as_small_as_the_rate_limit_demands():
    found = levels(target(1e9, 1e9)).rms
    assert found["soft"] == pytest.approx(0.01)
    assert found["stiff"] < 0.01
    quick = replace(RIG, drives=tuple(replace(one, slew_limit=200.0) for one in RIG.drives))
    assert levels(target(1e9, 1e9), rig=quick).rms["stiff"] == pytest.approx(0.01)


def test_a_response_that_a_drive_does_not_move_determines_nothing():
    noise = replace(PRE_TEST, peak=np.array([[2e4, 1e-3], [0.0, 50.0]]))
    assert levels(pre_test=noise).rms == levels().rms


def test_the_campaign_has_the_levels_their_spectrum_and_the_second_experiment(tmp_path):
    text = campaign_text("front_axle_demo", path=tmp_path / "mine.yaml", rig=RIG, levels=levels())
    excitation = yaml.safe_load(text)["excitation"]
    assert excitation["rms"] == levels().rms
    assert (excitation["corner_frequency"], excitation["decibels_per_octave"]) == (1, 6)
    assert excitation["at_target"] == {"level": 0.5, "duration": excitation["duration"]}
    assert "by the pulses of pre-test pair-pre-test:\n" in text
    assert parse_campaign(text, name="mine.yaml").excitation.at_target is not None


@pytest.mark.parametrize("template", ["front_axle_demo", "belgian_block", "spindle_coupled_demo"])
def test_the_rig_of_a_shipped_campaign_gets_the_spectrum_of_the_levels_too(tmp_path, template):
    shipped = parse_campaign(campaign_text(template, path=tmp_path / "mine.yaml"), name="mine.yaml")
    text = campaign_text(template, path=tmp_path / "mine.yaml", rig=replace(RIG, name=shipped.rig), levels=levels())
    excitation = yaml.safe_load(text)["excitation"]
    assert (excitation["rms"], excitation["decibels_per_octave"]) == (levels().rms, 6)


def test_more_responses_than_drives_or_too_short_drives_leave_the_second_experiment_out(tmp_path):
    more = replace(RIG, responses=(*RIG.responses, replace(RIG.responses[0], name="middle")))
    for rig in (more, replace(RIG, longest_drive_seconds=20.0)):
        text = campaign_text("front_axle_demo", path=tmp_path / "mine.yaml", rig=rig, levels=levels())
        assert "at_target" not in yaml.safe_load(text)["excitation"]


def test_a_pre_test_of_other_channels_and_a_target_that_does_not_move_are_refused():
    other = replace(PRE_TEST, drives=(replace(RIG.drives[0], unit="mm"), RIG.drives[1]))
    with pytest.raises(InputError, match=r"The pre-test 'pair-pre-test' has stiff \[mm\], soft \[m\].* rig 'pair'"):
        levels(pre_test=other)
    with pytest.raises(InputError, match=r"target of rear does not move from 0\.5 to 35 Hz"):
        levels(target(1000.0, 0.0, offset=5000.0))
