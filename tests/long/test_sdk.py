"""Waiting, stopping and watching with the SDK, synchronous and `async`, against real services."""

from __future__ import annotations

import asyncio
import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

import duralab
from duralab.cli.application import app
from iterator import control_band

RIG = "front_axle_compliant"
MINUTE = np.zeros((6, 60_000))
LEVELS = {"vertical": 0.004, "lateral": 0.003, "longitudinal": 0.001}


def campaign() -> duralab.Campaign:
    shipped = duralab.load_campaign("front_axle_demo")
    road = shipped.target.road.model_copy(update={"duration": 8.0, "potholes": None})
    return shipped.model_copy(
        update={
            "name": "sdk",
            "rig": RIG,
            "target": shipped.target.model_copy(update={"road": road}),
            "excitation": shipped.excitation.model_copy(update={"duration": 40.0, "at_target": None}),
            "stop": shipped.stop.model_copy(update={"iterations": 2}),
        }
    )


@pytest.fixture(autouse=True)
def rigs_are_reset(lab):
    yield
    for rig in lab.rig_names():
        lab.reset(rig)


def until(condition, *, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_playback_past_its_time_stops_the_rig_and_leaves_it_latched(lab):
    with pytest.raises(duralab.LabTimeoutError, match=r"longer than the 0\.3 s allowed.*latched") as caught:
        lab.play(RIG, MINUTE, real_time=True, timeout_seconds=0.3)
    assert isinstance(caught.value, TimeoutError)
    state = lab.state(RIG)
    assert state.resting
    assert state.mode is duralab.RigMode.INTERLOCKED
    with pytest.raises(duralab.NotReadyError, match="reset it"):
        lab.play(RIG, MINUTE[:, :100])
    assert lab.reset(RIG).mode is duralab.RigMode.IDLE
    assert lab.play(RIG, MINUTE[:, :100], timeout_seconds=60.0).response.samples.shape == (6, 100)


@pytest.mark.parametrize("ask", ["state", "reset", "stop_rig", "proposal"])
def test_a_name_that_stands_for_all_asks_nothing(lab, ask):
    with pytest.raises(duralab.InputError, match="stands for all, which can only be watched; give the name of one"):
        getattr(lab, ask)("*")


def test_who_reset_a_rig_and_why_stands_in_its_state_also_from_the_command_line(lab):
    lab.stop_rig(RIG, reason="oil on the floor")
    with pytest.raises(duralab.InputError, match=r"reason has 301 characters; give at most 300\.") as caught:
        lab.reset(RIG, name="Ada", reason="x" * 301)
    assert caught.value.field == "reason"
    state = lab.reset(RIG, name="Ada", reason="the floor is dry")
    assert (state.mode, state.reset_name, state.reset_reason) == (duralab.RigMode.IDLE, "Ada", "the floor is dry")
    lab.stop_rig(RIG, reason="again")
    command = ["reset", RIG, "--connect", lab.endpoints[0], "--name", "Grace", "--reason"]
    refused = CliRunner().invoke(app, [*command, "a\nb"])
    assert (refused.exit_code, "give printable characters on one line" in refused.stderr) == (2, True)
    assert lab.state(RIG).mode is duralab.RigMode.INTERLOCKED
    assert CliRunner().invoke(app, [*command, "a hose was loose"]).exit_code == 0
    state = lab.state(RIG)
    assert (state.reset_name, state.reset_reason) == ("Grace", "a hose was loose")


def test_a_playback_that_another_thread_cancels_is_stopped(lab):
    cancel = threading.Event()
    threading.Timer(0.3, cancel.set).start()
    with pytest.raises(duralab.StoppedError, match="stopped by the script"):
        lab.play(RIG, MINUTE, real_time=True, cancel=cancel)
    assert lab.state(RIG).resting


def test_an_identification_that_is_cancelled_leaves_its_rig_at_rest_and_latched(lab):
    cancel = threading.Event()
    shipped = duralab.load_campaign("front_axle_demo")
    excitation = shipped.excitation.model_copy(update={"duration": 600.0})

    def tell(progress: duralab.RunProgress) -> None:
        if progress.activity == "playing":
            cancel.set()

    with pytest.raises(duralab.StoppedError, match=f"identification of rig '{RIG}' was stopped.*latched"):
        lab.identify(RIG, excitation, shipped.estimator, on_progress=tell, cancel=cancel)
    state = lab.state(RIG)
    assert (state.resting, state.mode) == (True, duralab.RigMode.INTERLOCKED)


def test_a_second_playback_meets_a_busy_rig_and_a_stop_from_elsewhere_ends_the_first(lab):
    failed: list[BaseException] = []

    def play() -> None:
        try:
            lab.play(RIG, MINUTE, real_time=True)
        except duralab.LabError as error:
            failed.append(error)

    thread = threading.Thread(target=play)
    thread.start()
    until(lambda: lab.state(RIG).run)
    with pytest.raises(duralab.BusyError):
        lab.play(RIG, MINUTE[:, :100])
    state = lab.stop_rig(RIG, reason="enough")
    thread.join()
    assert (state.resting, state.reason) == (True, "enough")
    assert isinstance(failed[0], duralab.StoppedError)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_a_time_that_is_none_is_refused_before_anything_moves(lab, seconds):
    for call in (lambda **time: lab.play(RIG, MINUTE, **time), lab.watch):
        with pytest.raises(duralab.InputError, match="timeout_seconds"):
            call(timeout_seconds=seconds)
    assert lab.state(RIG).mode is duralab.RigMode.IDLE


def test_a_campaign_is_stopped_by_another_thread_and_leaves_the_rig_at_rest(lab):
    cancel = threading.Event()

    def tell(progress: duralab.RunProgress) -> None:
        if progress.stage is duralab.Stage.CAMPAIGN:
            cancel.set()

    with pytest.raises(duralab.StoppedError, match="The campaign 'sdk' was stopped by the script"):
        lab.run(campaign(), on_progress=tell, cancel=cancel)
    until(lambda: lab.state(RIG).resting)
    assert lab.stop("sdk").activity.startswith("stopped")
    # Whatever it did at that moment.
    assert lab.state(RIG).mode is duralab.RigMode.INTERLOCKED


def test_a_campaign_past_its_time_ends_with_that_error(lab):
    with pytest.raises(duralab.LabTimeoutError, match=r"longer than the 0\.01 s allowed"):
        lab.run(campaign(), timeout_seconds=0.01)


def test_a_watch_sees_every_sample_of_a_playback_and_what_the_rig_does(lab):
    drive = 0.001 * np.random.default_rng(1).standard_normal((6, 1000)).cumsum(axis=1) * np.hanning(1000)
    drive *= 0.002 / np.abs(drive).max()
    with lab.watch(rig=RIG, kinds=[duralab.Watched.SIGNALS, duralab.Watched.RIG_STATES], timeout_seconds=30.0) as watch:
        played = lab.play(RIG, drive)
        blocks, states = [], []
        for event in watch:
            match event:
                case duralab.SignalsEvent():
                    blocks.append(event)
                case duralab.RigEvent(state):
                    states.append(state)
            if blocks and blocks[-1].last and states and states[-1].resting:
                break
    seen = np.concatenate([block.response.samples for block in blocks], axis=1)
    np.testing.assert_array_equal(seen, played.response.samples)
    np.testing.assert_array_equal(np.concatenate([block.drive.samples for block in blocks], axis=1), drive)
    assert duralab.RigMode.PLAYING in {state.mode for state in states}
    assert {block.run for block in blocks} == {played.run}
    assert watch.dropped == 0
    assert list(watch) == []


def test_a_watch_of_a_silent_lab_ends_with_a_sentence_and_one_of_nothing_names_it(lab):
    watch = lab.watch(kinds=[duralab.Watched.CAMPAIGNS], timeout_seconds=0.2)
    with watch, pytest.raises(duralab.LabTimeoutError, match=r"silent for 0\.2 s"):
        next(watch)
    with pytest.raises(duralab.InputError, match="nobody"):
        lab.watch(campaign="nobody")


def test_a_closed_watch_lets_go_of_who_waits_for_it(lab):
    watch = lab.watch()
    threading.Timer(0.2, watch.close).start()
    assert list(watch) == []


def test_async_tasks_work_at_the_same_time_and_a_cancelled_one_stops_its_rig(lab):
    async def script() -> None:
        told: list[duralab.RunProgress] = []
        threads: set[int] = set()
        async with duralab.async_connect(lab.endpoints[0]) as mine:
            rigs = await mine.rigs()
            assert [rig.name for rig in rigs] == ["front_axle", RIG, "predecessor"]
            road = np.zeros((8, 500))
            road[[i for i, c in enumerate(rigs[-1].drives) if c.name.endswith("speed")]] = 10.0

            def tell(progress: duralab.RunProgress) -> None:
                threads.add(threading.get_ident())
                told.append(progress)

            played = await asyncio.gather(
                mine.play(RIG, MINUTE[:, :500], on_progress=tell), mine.play("predecessor", road)
            )
            assert [each.response.samples.shape for each in played] == [(6, 500), (6, 500)]
            async with await mine.watch(rig=RIG, kinds=[duralab.Watched.RIG_STATES]) as watch:
                task = asyncio.create_task(mine.play(RIG, MINUTE, real_time=True))
                async for event in watch:
                    if event.state.mode is duralab.RigMode.PLAYING:
                        break
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            state = await mine.state(RIG)
            assert (state.resting, state.mode) == (True, duralab.RigMode.INTERLOCKED)
            assert (await mine.reset(RIG)).mode is duralab.RigMode.IDLE
            with pytest.raises(duralab.LabTimeoutError):
                await mine.play(RIG, MINUTE, real_time=True, timeout_seconds=0.2)
        assert threads <= {threading.get_ident()}

    asyncio.run(script())


def test_an_async_campaign_is_watched_to_its_end(lab):
    async def script() -> None:
        async with duralab.async_connect(lab.endpoints[0]) as mine:
            async with await mine.watch(kinds=[duralab.Watched.CAMPAIGNS], timeout_seconds=60.0) as watch:
                task = asyncio.create_task(mine.run(campaign()))
                async for event in watch:
                    last = event
                    if event.ended:
                        break
            result = await task
            assert last.id == result.status.id
            np.testing.assert_array_equal(
                last.progress.iterations.relative_rms_error, result.iterations.relative_rms_error
            )
            # One that has ended already is told once more, and that is all.
            again = [event async for event in await mine.watch(campaign=last.id)]
            assert [event.ended for event in again] == [True]

    asyncio.run(script())


def test_a_lab_of_its_own_can_be_async():
    async def script() -> None:
        async with duralab.async_start(rigs=(RIG,)) as mine:
            assert (await mine.describe(RIG)).name == RIG
            with pytest.raises(duralab.InputError, match="no rig 'other'"):
                await mine.describe("other")

    asyncio.run(script())


def test_a_script_identifies_a_rig_at_its_own_target(lab):
    rig = lab.describe("front_axle_compliant")
    estimator = duralab.load_campaign("front_axle_demo").estimator
    excitation = duralab.ExcitationSettings(
        lowest_frequency=0.5,
        highest_frequency=40.0,
        corner_frequency=1.0,
        decibels_per_octave=6.0,
        rms={f"{side}_{axis}": rms for side in ("left", "right") for axis, rms in LEVELS.items()},
        duration=38.0,
        fade=1.0,
        at_target={"level": 0.5, "duration": 38.0},
    )
    # Falls with frequency like a road: at small strokes friction would hold the rig, and no model would fit both.
    noise = np.cumsum(np.random.default_rng(1).standard_normal((len(rig.drives), 20_000)), axis=1)
    hidden = control_band(1.0, 30.0, sample_rate=1000.0).limit_response(noise) * np.hanning(20_000)
    hidden *= np.array([[rms] for rms in 2 * tuple(LEVELS.values())]) / hidden.std(axis=1, keepdims=True)
    target = lab.play(rig.name, hidden).response
    first = lab.identify(rig.name, excitation, estimator, seed=1)
    second = lab.identify(rig.name, excitation, estimator, seed=1, target=target, band=(1.0, 30.0))

    def level(model):
        known = np.isfinite(model.coherence).all(axis=1)
        spacing = model.frequency[1] - model.frequency[0]
        return np.sqrt(model.response_psd[known].sum(axis=0) * spacing) / target.samples.std(axis=1)

    # Friction takes its share of small motions.
    assert np.all((level(second) > 0.25) & (level(second) < 0.65))
    assert np.ptp(np.log(level(second))) < np.ptp(np.log(level(first)))
    for given, sentence in (
        ({"target": target}, "band is not given"),
        ({"band": (1.0, 30.0)}, "target is not given"),
    ):
        with pytest.raises(duralab.InputError, match=sentence):
            lab.identify(rig.name, excitation, estimator, **given)
    # Friction holds the rig in so quiet an experiment.
    quiet = excitation.model_copy(update={"rms": duralab.load_campaign("front_axle_demo").excitation.rms})
    with pytest.raises(duralab.LabError, match="is allowed; identify the rig louder or longer before"):
        lab.identify(rig.name, quiet, estimator, seed=1, target=target, band=(1.0, 30.0))
    alone = excitation.model_copy(update={"at_target": None})
    with pytest.raises(duralab.InputError, match=r"excitation\.at_target is not; give its level"):
        lab.identify(rig.name, alone, estimator, target=target, band=(1.0, 30.0))
