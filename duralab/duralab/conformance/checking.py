"""The whole conformance check of a rig: every check once, in an order in which a bad rig is moved least."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing, suppress

from duralab.conformance.bench import Bench, BreachError, Finding, NotTriedError, Outcome, check_numbering, expect
from duralab.conformance.description_checks import (
    check_channels,
    check_figures,
    check_is_idle,
    check_is_live,
    check_is_stable,
)
from duralab.conformance.play_checks import PlayChecks
from duralab.conformance.refusal_checks import RefusalChecks
from duralab.conformance.stop_checks import StopChecks
from duralab_bus import Bus, FaultError
from duralab_proto.arrays import ArrayError

Tell = Callable[[Finding], None]
#: Length of each of the two playbacks that move the rig, in s.
MOVE_SECONDS = 2.0


def check_rig(bus: Bus, rig: str, *, seconds: float = MOVE_SECONDS, tell: Tell | None = None) -> list[Finding]:
    """Run the contract of docs/contract.md against a rig on the bus; return one finding for each check, in order.

    The rig is moved twice for `seconds`, by at most 5 % of its limits, stopped once and reset. A rig that is not idle
    is left alone. `tell` is called with each finding as soon as it is made.
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
    """Makes checks and keeps what was found."""

    def __init__(self, tell: Tell) -> None:
        self.findings: list[Finding] = []
        self._tell = tell
        self._given_up = ""

    def give_up(self, sentence: str) -> None:
        """Try nothing from here on."""
        self._given_up = sentence

    def __call__(self, name: str, check: Callable[[], None]) -> bool:
        """Make a check; return whether it passed."""
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
