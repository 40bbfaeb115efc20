"""Conformance check of a rig: every check once, in an order that moves a faulty rig as little as possible."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import closing, suppress

import numpy as np

from duralab.conformance.bench import Bench, BreachError, Finding, NotTriedError, Outcome, check_numbering, expect
from duralab.conformance.play_checks import PlayChecks
from duralab.conformance.refusal_checks import RefusalChecks
from duralab.conformance.stop_checks import StopChecks
from duralab_bus import Bus, FaultError
from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.channels import UNIT_OF_KIND
from duralab_proto.v1 import array_pb2, rig_pb2

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def check_is_live(bench: Bench) -> None:
    """Check that the rig's liveliness token is on the bus."""
    expect(
        ("rig_sim", bench.rig) in bench.bus.discover("rig_sim", bench.rig),
        f"the liveliness token live/rig_sim/{bench.rig} is not on the bus; declare it last.",
    )


def check_figures(bench: Bench) -> None:
    """Check that name, rate, lengths, static response and hash are present and valid."""
    description = bench.description
    expect(description.rig == bench.rig, f"the description is of {description.rig!r}; asked was {bench.rig!r}.")
    for field in ("specimen", "engine", "version"):
        expect(bool(getattr(description, field)), f"{field} is empty; say what it is.")
    for field in ("sample_rate", "longest_drive_seconds"):
        value = getattr(description, field)
        expect(np.isfinite(value) and value > 0.0, f"{field} is {value:g}; it must be above 0.")
    expect(description.block_samples > 0, "block_samples is 0; say how many samples a full signal block has.")
    expect(
        re.fullmatch(r"[0-9a-f]{64}", description.content_hash) is not None,
        f"content_hash is {description.content_hash!r}; it must be a SHA-256 in hexadecimal.",
    )
    expect(len(set(description.bodies)) == len(description.bodies), "two bodies of the pose stream have one name.")
    try:
        from_array(
            description.static_response, field="static_response", shape=(len(description.responses),), dtype=np.float64
        )
    except ArrayError as error:
        expect(False, f"{str(error).rstrip('.')}; it must hold one finite value for each response.")


def check_channels(bench: Bench) -> None:
    """Check that names, units and limits of drives and responses are valid."""
    _check_channels("drive", bench.description.drives)
    _check_channels("response", bench.description.responses)
    _check_sensors(bench.description.responses)
    for channel in bench.description.drives:
        expect(
            channel.minimum <= 0.0 <= channel.maximum,
            f"drive {channel.name!r} goes from {channel.minimum:g} to {channel.maximum:g}; 0 is where it begins.",
        )


def _check_sensors(responses: Sequence[array_pb2.Channel]) -> None:
    names = [channel.name for channel in responses if not channel.calculated]
    for channel in responses:
        sensor, what = channel.sensor, f"response {channel.name!r}"
        for term in channel.calculated:
            expect(
                term.channel in names and bool(np.isfinite(term.weight)),
                f"{what} is calculated from {term.weight:g} times {term.channel!r}; terms are finite weights of "
                "measured responses.",
            )
        for field in ("calibration_date", "calibration_due"):
            text = getattr(sensor, field)
            expect(
                not text or re.fullmatch(r"\d{4}-\d{2}-\d{2}", text) is not None,
                f"{what} has the {field} {text!r}; a date is YYYY-MM-DD.",
            )
        levels = (sensor.warning_level, sensor.abort_level)
        expect(
            bool(np.isfinite(levels).all()) and min(levels) >= 0.0 and (not levels[1] or levels[0] < levels[1]),
            f"{what} has the warning level {levels[0]:g} and the abort level {levels[1]:g}; they are 0 or in order.",
        )


def check_is_stable(bench: Bench) -> None:
    """Check that a second query returns the same description."""
    again = bench.describe()
    expect(
        again.SerializeToString(deterministic=True) == bench.description.SerializeToString(deterministic=True),
        "the description is another one when asked again; it may change only with the rig.",
    )


def check_is_idle(bench: Bench) -> None:
    """Check that the rig can play: it is at rest and not latched."""
    state = bench.state()
    expect(state.rig == bench.rig, f"the state is of {state.rig!r}; asked was {bench.rig!r}.")
    expect(
        state.mode == rig_pb2.RIG_MODE_IDLE,
        f"the rig is {rig_pb2.RigMode.Name(state.mode)} ({state.reason or state.run}); a check begins with an idle "
        "rig, see to it and reset it.",
    )
    expect(not state.reason and not state.run, "an idle rig has a reason or a run; both must be empty.")


def _check_channels(what: str, channels: Sequence[array_pb2.Channel]) -> None:
    expect(bool(channels), f"it has no {what}s; it needs at least one.")
    names = [channel.name for channel in channels]
    expect(len(set(names)) == len(names), f"two {what}s have one name; names must differ.")
    for channel in channels:
        expect(
            _NAME.fullmatch(channel.name) is not None,
            f"a {what} is called {channel.name!r}; names are lower_snake_case.",
        )
        unit = UNIT_OF_KIND.get(channel.kind)
        expect(unit is not None, f"{what} {channel.name!r} has no kind; say what it is.")
        expect(
            channel.unit == unit,
            f"{what} {channel.name!r} is in {channel.unit!r}; its kind is in {unit!r}, SI units throughout.",
        )
        limits = np.array([channel.minimum, channel.maximum, channel.slew_limit])
        expect(
            bool(np.all(np.isfinite(limits))) and channel.minimum < channel.maximum and channel.slew_limit >= 0.0,
            f"{what} {channel.name!r} goes from {channel.minimum:g} to {channel.maximum:g} at up to "
            f"{channel.slew_limit:g} a second; limits are finite and in order.",
        )
        expect(
            0.0 <= channel.actuator_speed < np.inf,
            f"{what} {channel.name!r} states an actuator_speed of {channel.actuator_speed:g}; it is finite, 0 or more.",
        )


Tell = Callable[[Finding], None]
#: Length of each of the two playbacks that move the rig, in s.
MOVE_SECONDS = 2.0


def check_rig(bus: Bus, rig: str, *, seconds: float = MOVE_SECONDS, tell: Tell | None = None) -> list[Finding]:
    """Check a rig on the bus against docs/contract.md; return one finding for each check, in order.

    The rig is moved twice for `seconds`, by at most 1 % of its limits, stopped once and reset. A rig that is not idle
    is not moved. `tell` is called with each finding at once.
    """
    with closing(Bench(bus, rig, seconds=seconds)) as bench:
        run = _Run(tell or (lambda _finding: None))
        _check(run, bench)
        return run.findings


def _check(run: _Run, bench: Bench) -> None:
    described = (
        run("live", lambda: check_is_live(bench))
        and run("description", lambda: _describe(bench))
        and run("description.figures", lambda: check_figures(bench))
        and run("description.channels", lambda: check_channels(bench))
        and run("description.stable", lambda: check_is_stable(bench))
        and run("state.idle", lambda: check_is_idle(bench))
    )
    if not described:
        run.give_up("the rig was not moved: what comes first failed.")
    refusals = RefusalChecks(bench)
    for name, check in refusals.checks().items():
        run(name, check)
    play = PlayChecks(bench)
    run("play", play.check_plays)
    run("play.stream", play.check_stream)
    run("play.progress", play.check_progress)
    run("play.state", play.check_state)
    run("play.poses", play.check_poses)
    run("refuse.run_twice", lambda: refusals.check_twice(play.played_run))
    stop = StopChecks(bench)
    try:
        run("stop", stop.check_busy_and_stops)
        run("stop.cancelled", stop.check_ends_cancelled)
        run("stop.ramp_down", stop.check_ramps_down)
        run("stop.state", stop.check_state)
        run("refuse.interlocked", stop.check_refuses)
        run("reset", stop.check_resets)
    finally:
        with suppress(FaultError):
            stop.clean_up()
    run("state.stream", lambda: _check_states(bench))


def _describe(bench: Bench) -> None:
    bench.description = bench.describe()


def _check_states(bench: Bench) -> None:
    expect(bool(bench.states), "no state was published.")
    check_numbering(list(bench.states), "state stream")
    expect(not bench.problems, f"a stream message could not be read: {'; '.join(bench.problems[:1])}")


class _Run:
    """Runner of checks that collects the findings."""

    def __init__(self, tell: Tell) -> None:
        self.findings: list[Finding] = []
        self._tell = tell
        self._given_up = ""

    def give_up(self, sentence: str) -> None:
        """Skip all further checks."""
        self._given_up = sentence

    def __call__(self, name: str, check: Callable[[], None]) -> bool:
        """Run a check; return whether it passed."""
        finding = self._make(name, check)
        self.findings.append(finding)
        self._tell(finding)
        return finding.outcome is Outcome.PASSED

    def _make(self, name: str, check: Callable[[], None]) -> Finding:
        if self._given_up:
            return Finding(name, Outcome.NOT_TRIED, self._given_up)
        try:
            check()
        except NotTriedError as reason:
            return Finding(name, Outcome.NOT_TRIED, str(reason))
        except (BreachError, ArrayError) as breach:
            return Finding(name, Outcome.FAILED, str(breach))
        except FaultError as fault:
            return Finding(name, Outcome.FAILED, f"it was answered with {fault.code_name}: {fault.message}")
        return Finding(name, Outcome.PASSED)
