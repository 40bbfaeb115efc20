"""Goals and results of the benchmarks: the table of `docs/benchmarks.md`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

SUSPENSION_RIGS = (
    "front_axle",
    "front_axle_compliant",
    "front_axle_sensors",
    "full_vehicle",
    "macpherson",
    "macpherson_compliant",
    "predecessor",
    "spindle_coupled",
    "spindle_coupled_braking",
)


@dataclass(frozen=True)
class Goal:
    """A figure and its bound, or a fact without one.

    Parameters
    ----------
    what : str
        In words, with the unit of both numbers.
    figure : tuple of str
        Where it is in out/bench.json.
    bound : float, optional
        The most that is allowed, or the least where `at_least`; none where no user needs one.
    at_least : bool
        Which of the two.
    possible : tuple of float
        Least and largest value that the figure can have: outside of them it is no measurement.
    scale : float
        From the figure's unit to that of the words.
    """

    what: str
    figure: tuple[str, ...]
    bound: float | None
    at_least: bool = False
    possible: tuple[float, float] = (0.0, math.inf)
    scale: float = 1.0

    def measured(self, document: dict[str, Any]) -> float | None:
        """Return the result in the unit of the text; None if it was not measured."""
        found: Any = document
        for name in self.figure:
            if not isinstance(found, dict) or name not in found:
                return None
            found = found[name]
        return None if found is None else float(found) * self.scale

    def verdict(self, measured: float) -> str:
        """Return whether a figure is within the bound: met, missed, or no measurement; nothing of a fact."""
        least, largest = self.possible
        if not least <= measured <= largest:
            return "no measurement"
        if self.bound is None:
            return ""
        return "met" if (measured >= self.bound if self.at_least else measured <= self.bound) else "missed"


def _least(what: str, *figure: str, bound: float, scale: float = 1.0) -> Goal:
    return Goal(what, figure, bound, at_least=True, scale=scale)


def _most(what: str, *figure: str, bound: float, scale: float = 1.0) -> Goal:
    return Goal(what, figure, bound, scale=scale)


def _share(what: str, *figure: str, bound: float) -> Goal:
    return Goal(what, figure, bound, possible=(0.0, 100.0), scale=100.0)


def _efficiency(what: str, *figure: str, bound: float) -> Goal:
    return Goal(what, figure, bound, at_least=True, possible=(0.0, 1.0))


def _fact(what: str, *figure: str, scale: float = 1.0) -> Goal:
    return Goal(what, figure, None, possible=(-math.inf, math.inf), scale=scale)


_IDENTIFICATION = "identification"
_ITERATION = "iteration"

GOALS: dict[str, tuple[Goal, ...]] = {
    "Rigs": (
        *(_least(f"`{rig}`: times real time on one core", "rigs", rig, "rtf", bound=80.0) for rig in SUSPENSION_RIGS),
        _least("`predecessor`, its sides independent: times real time", "rigs", "predecessor", "rtf", bound=200.0),
        *(_most(f"`{rig}`: error of a playback", "rigs", rig, "error", bound=1e-3) for rig in SUSPENSION_RIGS),
    ),
    "Variants of `front_axle` in the lanes of vectors, one core": (
        _least("one alone: times real time", "lanes", "rtf", bound=200.0),
        _least("four together over one, AVX2", "lanes", "four_over_one", bound=1.8),
        _least("eight together over one, AVX-512", "lanes", "eight_over_one", bound=2.5),
        _most("error against each alone", "lanes", "error", bound=1e-3),
    ),
    "Identification: 8 × 8, 600 s at 1 kHz, block 2048, one core": (
        _least(
            "times faster than a loop of `scipy.signal.csd`", _IDENTIFICATION, "times_faster_than_csd_pairs", bound=40.0
        ),
        _most(
            "averaged spectra over the windowed transforms alone, by `scipy.fft`",
            _IDENTIFICATION,
            "over_plain_windowed_transforms",
            bound=1.25,
        ),
        _fact(
            "the same, over transforms into existing memory",
            _IDENTIFICATION,
            "over_windowed_transforms",
        ),
        *(
            _least(f"H1: times faster than {name}", _IDENTIFICATION, "peers", peer, "times_faster", bound=3.0)
            for peer, name in (("sdynpy", "SDynPy"), ("pyfrf", "pyFRF"), ("rattlesnake", "Rattlesnake's core"))
        ),
        _most("H1: memory above the records, MiB", _IDENTIFICATION, "h1_memory_mebibytes", bound=30.0),
        _most(
            "local rational method, 6 × 6, 240 s: s", _IDENTIFICATION, "local_rational_6x6_240_s_seconds", bound=10.0
        ),
    ),
    "Iteration: 8 × 8, 120 s at 1 kHz, one core": (
        _most("basic TWR over its transforms alone", _ITERATION, "basic_twr_over_transforms", bound=1.5),
        _most("basic TWR, ms", _ITERATION, "update_seconds", "basic_twr", bound=60.0, scale=1e3),
        _most("secant update after 10 playbacks, over basic TWR", _ITERATION, "secant_over_basic_twr", bound=10.0),
        _most("the same without odd terms, over basic TWR", _ITERATION, "without_odd_terms_over_basic_twr", bound=10.0),
        _most("the same by Gauss-Newton, over the one without", _ITERATION, "gauss_newton_over_secant", bound=6.0),
        _least("first drive: times faster than SDynPy", _ITERATION, "peers", "sdynpy", "times_faster", bound=1.0),
    ),
    "Streams of 12.8 KB on loopback": (
        _least("blocks/s for a minute", "bus", "sustained", "rate", bound=5000.0),
        *(_most(f"of them {how}", "bus", "sustained", how, bound=0.0) for how in ("lost", "doubled", "reordered")),
        _fact("share of a bare pipe's rate that is lost, %", "bus", "pipe", "share_lost_spool_on_disk", scale=100.0),
        _least("blocks/s for a second, the middle of five", "bus", "burst", "rate", bound=15_000.0),
        _most("longest that a publisher was held up, ms", "bus", "sustained", "longest_put", bound=20.0, scale=1e3),
        _most("caught up after a freeze of 8 s, s", "bus", "frozen_receiver", "caught_up", bound=5.0),
        _most("caught up after a kill, s", "bus", "killed_receiver", "caught_up", bound=5.0),
        _most("query and answer, the middle one, ms", "bus", "queries", "round_trip_p50", bound=1.0, scale=1e3),
        _most("answer of 2 MB, the middle one, ms", "bus", "queries", "reply_of_2_MB_p50", bound=10.0, scale=1e3),
        _most("a dead service is noticed after s", "bus", "noticed", "dead", bound=0.5),
        _most("a frozen service is noticed after s", "bus", "noticed", "frozen", bound=3.0),
    ),
    "Log and live view": (
        _most("10 s out of 800 s, the middle one, ms", "recorder", "window_median_ms", bound=20.0),
        _least("scalars/s of the live view, millions", "live_view", "scalars_per_second", bound=1.0, scale=1e-6),
    ),
    "What a person waits for": (
        _most("`import duralab`, s", "startup", "import duralab", "wall", bound=0.5),
        _most("`duralab --help`, s", "startup", "duralab --help", "wall", bound=0.7),
        _most("`duralab up` to the first answer of a rig, warm, s", "lab", "first_answer_warm", bound=1.5),
        _fact("the same, without compiled code on disk, s", "lab", "first_answer_cold"),
        _most(
            "`duralab run front_axle_demo` from the shell, warm, over simulation and mathematics, the middle of seven",
            "lab",
            "campaign_over_simulation_and_mathematics",
            bound=1.6,
        ),
        _most("RPC III of int16 over numpy for its bytes", "formats", "SHORT_INTEGER", "read_over_numpy", bound=2.0),
        _most("RPC III of float32 over numpy for its bytes", "formats", "FLOATING_POINT", "read_over_numpy", bound=2.0),
        _most("report of ten playbacks, s", "report", "seconds", bound=10.0),
        _most("the same, MB", "report", "megabytes", bound=15.0),
    ),
    "Whole campaign": (
        _share("share of bus and disk in a campaign's time, %", "campaign", "bus_and_disk_share", bound=10.0),
        _share(
            "the same where the rig plays in real time, %", "campaign", "bus_and_disk_share_at_real_time", bound=10.0
        ),
    ),
    "Sweeps": (
        _efficiency("two cores over twice one core, a sweep of seeds", "sweep", "efficiency_steady", bound=0.85),
        _efficiency(
            "the same of tolerances, each campaign with another specimen", "tolerances", "efficiency_steady", bound=0.9
        ),
        _fact("campaigns of tolerances a minute on two cores", "tolerances", "campaigns_per_minute"),
    ),
}

_IDENTIFICATION_NOTE = """
The windowed transforms alone are reported twice: written plainly, and a few blocks at a time into existing memory; this
is how the spectra are made; the rest is the products of 16 channels at every line. H1 is reported with its
checks of every sample, coherence and uncertainty.
"""
_STREAMS_NOTE = """
Zenoh alone, without numbers, spool and replay and dropping what a link has no room for, published
{bus[burst_bare][rate]:,.0f} blocks/s for a second and was held up for {bus[sustained_bare][longest_put]:.3f} s at most
at the rate of the minute; through a bare pipe to an MCAP file, which drops nothing, went {bus[pipe][bare_rate]:,.0f}
blocks/s. The host of this machine took {bus[sustained][stolen_share]:.0%} of its busy processors in that
minute.
"""
_CAMPAIGN_NOTE = """
All of these come from the trace of one campaign, in which every moment counts once. The simulated rig plays
{campaign[rig_seconds]:.0f} s in {campaign[simulation_seconds]:.1f} s, the mathematics takes
{campaign[compute_seconds]:.1f} s more, and the campaign {campaign[wall_seconds]:.1f} s: the rest is
{campaign[disk_seconds]:.1f} s with recordings (every sample is stored and verified, drawn for the live view, and the
{campaign[megabytes]:.0f} MB are copied to where they were asked for), {campaign[service_seconds]:.1f} s with other work
of the services and {campaign[waiting_seconds]:.1f} s of waiting for one another. The share in real time is that of a
rig of steel.
"""

NOTES: dict[str, str] = {
    "Identification: 8 × 8, 600 s at 1 kHz, block 2048, one core": _IDENTIFICATION_NOTE,
    "Streams of 12.8 KB on loopback": _STREAMS_NOTE,
    "Whole campaign": _CAMPAIGN_NOTE,
}
"""Notes for the tables, by title; names in braces are looked up in the document."""
