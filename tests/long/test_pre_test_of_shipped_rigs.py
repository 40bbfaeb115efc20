"""Pre-tests of the shipped rigs: no healthy one is called faulty, and seeded faults are found on coupled ones."""

import numpy as np
import pytest

from iterator.limits import DriveLimits
from iterator.pre_test.expectation import Expectation, KnownFrf, expected_of_model, in_windows, within
from iterator.pre_test.judging import Check, Drive, ResponseChannel, judge
from iterator.pre_test.pulses import pulse_train
from rig_sim.loading import load_any_rig
from rig_sim.specimen import Quantity, shipped_specimens

SEEDS = range(4)


class Tried:
    """A shipped rig with its pulses, and what it answers to them."""

    def __init__(self, name):
        self.rig = load_any_rig(shipped_specimens()[name])
        self.specimen = specimen = self.rig.specimen
        drives = specimen.drives
        self.rate = specimen.sample_rate
        limits = DriveLimits(
            tuple(drive.name for drive in drives),
            tuple(drive.unit for drive in drives),
            *(np.array([getattr(drive, of) for drive in drives]) for of in ("minimum", "maximum", "slew_limit")),
            self.rate,
        )
        self.train = pulse_train(limits, sample_rate=self.rate, level=0.05)
        self.names = [channel.name for channel in specimen.responses]
        self.static = np.asarray(self.rig.static_response)

    def response(self, seed, drive=None):
        playback = self.rig.playback(self.train.drive if drive is None else drive, seed=seed)
        for _ in playback.blocks():
            pass
        self.uses = playback.uses()
        return playback.response

    def earlier(self, response):
        moved = response - response[:, : self.train.rest].mean(axis=1)[:, None]
        return Expectation(within(None, in_windows(moved, self.train), self.rate))

    def findings(self, response, expected=None):
        no_effect_alone = (Quantity.RATIO, Quantity.VELOCITY)
        drives = [
            Drive(drive.name, drive.quantity not in no_effect_alone, use.saturated_share)
            for drive, use in zip(self.specimen.drives, self.uses, strict=True)
        ]
        responses = [
            ResponseChannel(channel.name, channel.unit, -channel.range, channel.range, float(static))
            for channel, static in zip(self.specimen.responses, self.static, strict=True)
        ]
        judged = judge(
            self.train, response, drives=drives, responses=responses, sample_rate=self.rate, expected=expected
        )
        return judged.findings

    def found(self, response, expected=None):
        return {(finding.check, finding.channels) for finding in self.findings(response, expected) if finding.failed}


@pytest.mark.parametrize("name", shipped_specimens())
def test_no_healthy_rig_is_called_faulty(name):
    tried = Tried(name)
    answers = [tried.response(seed) for seed in SEEDS]
    for answer in answers:
        assert tried.findings(answer) == ()
        assert tried.findings(answer, tried.earlier(answers[0])) == ()


@pytest.mark.parametrize("name", ["front_axle", "macpherson_compliant", "spindle_coupled_braking", "aerospace"])
def test_seeded_faults_are_found(name):
    tried = Tried(name)
    expected, answer = tried.earlier(tried.response(99)), tried.response(1)
    static, count = tried.static[:, None], len(answer)
    ranges = [channel.range for channel in tried.specimen.responses]
    generator = np.random.default_rng(7)
    for row, channel in enumerate(tried.names):
        inverted, dead, noisy, shifted = (answer.copy() for _ in range(4))
        inverted[row] = 2.0 * static[row] - answer[row]
        assert tried.found(inverted, expected) == {(Check.POLARITY, (channel,))}
        dead[row] = answer[row, 0]
        assert (Check.DEAD, (channel,)) in tried.found(dead, expected)
        noisy[row] += 0.02 * ranges[row] * generator.standard_normal(answer.shape[1])
        assert (Check.NOISE, (channel,)) in tried.found(noisy, expected)
        shifted[row] += 0.05 * ranges[row]
        assert (Check.OFFSET, (channel,)) in tried.found(shifted, expected)
    for first, second in [(0, count // 2), (0, 1), (1, count - 1)]:
        order = np.arange(count)
        order[[first, second]] = second, first
        swapped = (answer - static)[order] + static
        assert (Check.SWAPPED, (tried.names[first], tried.names[second])) in tried.found(swapped, expected)


@pytest.mark.parametrize("name", ["front_axle", "spindle_coupled"])
def test_faults_of_drives_are_found_where_each_moves_several_responses(name):
    tried = Tried(name)
    expected, drive = tried.earlier(tried.response(99)), tried.train.drive
    names = [channel.name for channel in tried.specimen.drives]
    for row, channel in enumerate(names):
        inverted, dead = drive.copy(), drive.copy()
        inverted[row] *= -1.0
        assert (Check.POLARITY, (channel,)) in tried.found(tried.response(5, inverted), expected)
        dead[row] = 0.0
        assert (Check.DEAD, (channel,)) in tried.found(tried.response(5, dead), expected)
        assert (Check.DEAD, (channel,)) in tried.found(tried.response(5, dead))
    units = [channel.unit for channel in tried.specimen.drives]
    for first, second in [(0, 1), (0, 3), (2, 4)]:
        if units[first] != units[second]:
            continue
        order = np.arange(len(names))
        order[[first, second]] = second, first
        swapped = tried.response(5, drive[order])
        assert (Check.SWAPPED, (names[first], names[second])) in tried.found(swapped, expected)


def test_a_structure_is_compared_with_its_exact_frf():
    tried = Tried("aerospace")
    frequency = np.arange(0.0, tried.rate / 2.0 + 0.1, 0.125)
    known = KnownFrf(frequency, tried.rig.sampled_frf(frequency), (2.0, 120.0))
    expected = expected_of_model(known, tried.train, tried.rate)
    answer = tried.response(1)
    assert tried.findings(answer, expected) == ()
    answer[2] *= -1.0
    assert tried.found(answer, expected) == {(Check.POLARITY, (tried.names[2],))}
