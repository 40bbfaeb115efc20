"""Remarks on a drive that was carried into the rig's limits, on an actuator's rate limit, and on responses."""

from types import SimpleNamespace

import numpy as np
import pytest

from duralab_proto.v1 import array_pb2, iterator_pb2
from iterator import DriveLimits, Outcome, Segment, Standstill, control_band, judge_response, project_drive
from iterator.campaign.remarks import remarks_of
from iterator.model import RateLimit

RATE = 256.0
NAMES = ("left", "right")


def remarks(drive, *, peak, slew=0.0, rate_limits=(), stated=()):
    limits = DriveLimits(
        names=NAMES,
        units=("m", "m"),
        minimum=np.full(2, -peak),
        maximum=np.full(2, peak),
        slew_limit=np.full(2, slew),
        sample_rate=RATE,
    )
    projection = project_drive(drive, limits=limits, band=control_band(1.0, 30.0, sample_rate=RATE))
    description = SimpleNamespace(drives=[array_pb2.Channel(name=name, unit="m") for name in NAMES], responses=[])
    # Over, so that nothing is predicted of a next playback.
    iteration = SimpleNamespace(
        number=2,
        projection=projection,
        unreachable=(),
        stood_still=(),
        learned=None,
        outcome="reached",
        metrics=related(),
        passed_bound=None,
        model=SimpleNamespace(rate_limits=rate_limits, stated_rate_limits=stated),
        level=0.5,
    )
    return projection, remarks_of(iteration, plan=SimpleNamespace(description=description))


def related(*correlations):
    return SimpleNamespace(correlation=np.array(correlations))


@pytest.fixture
def tones():
    """5 Hz with an amplitude of 1 on the left and 0.1 on the right."""
    time = np.arange(4096) / RATE
    fade = np.minimum(1.0, np.minimum(time, time[::-1]))
    return np.array([[1.0], [0.1]]) * np.sin(2 * np.pi * 5 * time) * fade


def test_how_much_a_drive_was_changed_is_told_for_the_channel_alone_that_was(tones):
    projection, told = remarks(tones, peak=0.8)
    left = np.sqrt(np.mean((projection.drive - tones)[0] ** 2) / np.mean(tones[0] ** 2))
    assert left > 0.01
    assert told[0].startswith("Playback 2: The drive of left would have passed its peak limit of 0.8 m")
    assert told[1:] == [
        f"Playback 2: The drive of left was changed by {100 * left:.2f} % of its RMS to hold its limits."
    ]


def test_what_had_to_be_clipped_is_told(tones):
    # Above the band, where nothing is changed.
    tones[0] = 2.0 * np.cos(2.0 * np.pi * 50.0 * np.arange(4096) / RATE)
    projection, told = remarks(tones, peak=1.0, slew=100.0)
    assert projection.clipped[0] > 0.0
    assert told[-1].endswith(
        f"to hold its limits; {100 * projection.clipped[0]:.2f} % had to be clipped and lies outside the control band."
    )


def test_the_rate_limit_of_an_actuator_is_told(tones):
    assert remarks(tones, peak=2.0, rate_limits=(None, RateLimit(27.0, 1.2345)))[1] == [
        "Playback 2: right moved no faster than about 0.617 m/s in the playbacks before; look whether its valve is at "
        "its stop where the error is large."
    ]
    assert remarks(tones, peak=2.0, rate_limits=(None, None))[1] == []
    stated = (None, RateLimit(27.0, 1.2345))
    assert remarks(tones, peak=2.0, rate_limits=stated, stated=stated)[1] == []


def stood_still(number, *, weight, outcome, recorded=()):
    names = ("left_lateral", "beam")
    plan = SimpleNamespace(
        description=SimpleNamespace(drives=[], responses=[array_pb2.Channel(name=name, unit="N") for name in names]),
        response_weight=np.array(weight),
    )
    found = tuple(Standstill(response=i, segment=Segment(start=5.0, end=15.0)) for i in range(2))
    iteration = SimpleNamespace(
        number=number,
        projection=None,
        unreachable=(),
        stood_still=found,
        outcome=outcome,
        metrics=related(0.0, 0.0),
        passed_bound=None,
        learned=None,
        model=SimpleNamespace(rate_limits=(), stated_rate_limits=()),
    )
    return remarks_of(iteration, plan=plan, recorded=recorded)


def test_a_response_that_stood_still_is_told_with_the_time_and_what_to_do():
    told = stood_still(3, weight=(1.0, 0.0), outcome=Outcome.RESPONSE_STOOD_STILL)
    assert told == [
        "Playback 3: left_lateral stood still from 5.00 s for 10.00 s while its target moved; check the sensor and its "
        "cable, then resume from playback 2 or start anew.",
        "Playback 3: the monitored response beam stood still from 5.00 s for 10.00 s while its target moved; check the "
        "sensor and its cable.",
    ]
    recorded = [iterator_pb2.IterationStep(remarks=remarks) for remarks in ([], [], told)]
    assert stood_still(3, weight=(1.0, 0.0), outcome=Outcome.RESPONSE_STOOD_STILL, recorded=recorded) == told
    first = stood_still(1, weight=(1.0, 0.0), outcome=Outcome.RESPONSE_STOOD_STILL)
    assert first[0].endswith("check the sensor and its cable, then start anew.")


def test_a_controlled_response_that_reproduces_nothing_is_told():
    names = ("left", "right", "beam", "axle")
    plan = SimpleNamespace(
        description=SimpleNamespace(drives=[], responses=[array_pb2.Channel(name=name, unit="N") for name in names]),
        response_weight=np.array([1.0, 0.5, 0.0, 1.0]),
    )
    iteration = SimpleNamespace(
        number=4,
        projection=None,
        unreachable=(),
        stood_still=(),
        outcome="last",
        metrics=related(0.101, 0.0625, np.nan, 0.99),
        passed_bound=None,
        learned=None,
        model=SimpleNamespace(rate_limits=(), stated_rate_limits=()),
    )
    assert remarks_of(iteration, plan=plan) == [
        "Playback 4: right has a correlation of 0.06 with its target; check its sensor, its sign and the model there "
        "before the drive grows."
    ]


def test_the_correlation_of_a_response_is_that_of_its_samples():
    generator = np.random.default_rng(2)
    target = generator.standard_normal((4, 3000)) * [[1.0], [200.0], [1e-3], [1.0]]
    # Behind a sensor that hums, with some of the target, with the other sign, and at rest.
    response = np.array([1e-4, 150.0, 1e-5, 0.0])[:, None] * generator.standard_normal((4, 3000))
    response += np.array([0.0, 0.5, -0.3, 0.0])[:, None] * target
    expected = [
        np.sum(y * w) / np.sqrt(np.sum(y**2) * np.sum(w**2)) for y, w in zip(response[:3], target, strict=False)
    ]
    found = judge_response(target, response).correlation
    np.testing.assert_allclose(found, [*expected, 0.0], atol=1e-9)
    assert abs(found[0]) < 0.05
    assert found[2] < -0.9


def test_nothing_is_told_of_a_drive_that_fits(tones):
    assert remarks(tones, peak=2.0)[1] == []
