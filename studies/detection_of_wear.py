"""Wear and cracks in an endurance test: repeats until detection, and rate of missed changes.

`python studies/detection_of_wear.py` writes picture and tables of docs/studies/detection_of_wear.md again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from rig_cell import responses_of
from rig_wear import rough_road
from scipy.stats import chi2
from study_page import Findings, label, markdown_table, plt, run

from duralab_monitoring import Alarm, AlarmKind, ChangeWatch, Monitor, MonitoringSettings, Statistic
from rig_sim import Condition, Lost, WearState, load_rig, shipped_specimens

RIG: Final = load_rig(shipped_specimens()["front_axle_wearing"])
SAMPLE_RATE: Final = RIG.specimen.sample_rate
CHANNELS: Final = tuple(channel.name for channel in RIG.specimen.responses)
NOISE_RMS: Final = np.array([channel.noise_rms for channel in RIG.specimen.responses])
#: Events by the seed of their road; they are played in turn.
EVENTS: Final = {"road": 5, "other_road": 6}
BUSHING, LINK = "left_lower_rear_bushing", "left_tie_rod"
SETTINGS: Final = MonitoringSettings()
#: Repeats of the schedule before something changes, and over which a drift comes to its full size.
BEFORE: Final = 100
_DRIFT_REPEATS: Final = 1000
_GAIN_DRIFT: Final = 0.02
_DRIFTING_SENSOR: Final = "left_vertical"
_MOST_REPEATS: Final = 400


@dataclass(frozen=True)
class Scatter:
    """Differences of repeats: noise in multiples of the sensors', gain of each channel, start of the record in s."""

    name: str
    noise: float
    gain: float
    start: float


SENSORS: Final = Scatter("sensor noise", 1.0, 0.0, 0.0)
ROUGH: Final = Scatter("rough repeats", 4.0, 0.003, 2e-4)


@dataclass(frozen=True)
class Extent:
    """Extent of the study: seconds of an event, seeds, repeats of a seed for false alarms, repeats for the pictures.

    `lives`: Seeds of whole simulations with wear.
    """

    seconds: float
    seeds: int
    quiet_repeats: int
    compared_repeats: int
    lives: int


FULL: Final = Extent(6.0, 50, 10_000, 250, 5)
QUICK: Final = Extent(3.0, 2, 100, 20, 1)


@dataclass(frozen=True)
class Case:
    """Case of a change: the response to an event in a repeat, counted from the first changed one."""

    name: str
    kind: AlarmKind
    response: Callable[[str, int], NDArray[np.float64]]


def drives(seconds: float) -> dict[str, NDArray[np.float64]]:
    """Return the strokes of each event."""
    return {name: rough_road(RIG, seconds=seconds, seed=seed) for name, seed in EVENTS.items()}


def responses(
    files: dict[str, NDArray[np.float64]], conditions: Sequence[Condition]
) -> list[dict[str, NDArray[np.float64]]]:
    """Return the response to each event in each condition without the sensors' noise.

    Noise is all that repeats of one condition have.
    """
    noise = {name: NOISE_RMS[:, None] * noise_of(0, drive.shape[1]) for name, drive in files.items()}
    played = iter(
        responses_of(
            [RIG.playback(drive, seed=0, condition=condition) for condition in conditions for drive in files.values()]
        )
    )
    return [{name: next(played) - noise[name] for name in files} for _ in conditions]


def noise_of(seed: int, samples: int) -> NDArray[np.float64]:
    """Return the sensor noise of a playback with a seed, shape (channels, samples)."""
    return np.random.default_rng(seed).standard_normal((samples, NOISE_RMS.size)).T


def cases(seconds: float) -> tuple[dict[str, NDArray[np.float64]], list[Case]]:
    """Play the axle as new and changed; return its responses as new, and the cases."""
    files = drives(seconds)
    new, soft, drifted, cracked = responses(
        files,
        [
            RIG.changed(),
            RIG.changed({BUSHING: Lost(stiffness=0.1, damping=0.1)}),
            RIG.changed({BUSHING: Lost(stiffness=0.03, damping=0.03)}),
            RIG.changed({LINK: Lost(stiffness=0.8, damping=0.8)}),
        ],
    )
    sensor = np.array([[name == _DRIFTING_SENSOR] for name in CHANNELS]) * _GAIN_DRIFT
    sudden, slow = AlarmKind.SUDDEN_CHANGE, AlarmKind.SLOW_DRIFT

    def share(repeat: int) -> float:
        return min(1.0, (repeat + 1) / _DRIFT_REPEATS)

    return new, [
        Case("bushing loses 10 %, at once", sudden, lambda event, _: soft[event]),
        Case("tie rod cracks: 80 %, at once", sudden, lambda event, _: cracked[event]),
        Case(
            f"bushing loses 3 % in {_DRIFT_REPEATS:,} repeats",
            slow,
            lambda event, repeat: new[event] + share(repeat) * (drifted[event] - new[event]),
        ),
        Case(
            f"sensor gains 2 % in {_DRIFT_REPEATS:,} repeats",
            slow,
            lambda event, repeat: new[event] * (1.0 + share(repeat) * sensor),
        ),
    ]


def measured(response: NDArray[np.float64], scatter: Scatter, random: np.random.Generator) -> NDArray[np.float64]:
    """Return the measurement of a response in a repeat."""
    channels, samples = response.shape
    gain = 1.0 + scatter.gain * random.standard_normal((channels, 1))
    if scatter.start:
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(samples, 1.0 / SAMPLE_RATE) * random.uniform(-1, 1) * scatter.start)
        response = np.fft.irfft(np.fft.rfft(response) * turn, n=samples)
    noise = scatter.noise * NOISE_RMS[:, None] * random.standard_normal((channels, samples))
    return gain * response + noise


def new_monitor(events: Sequence[str]) -> Monitor:
    """Return the monitor of the study."""
    return Monitor(SETTINGS, events, channels=CHANNELS, sample_rate=SAMPLE_RATE)


@dataclass(frozen=True)
class Found:
    """First alarm of a case in one test, None without one."""

    case: Case
    alarm: Alarm | None

    @property
    def delay(self) -> float:
        """Repeats from the first that differs to the alarm, both included."""
        return np.inf if self.alarm is None else self.alarm.repeat - BEFORE + 1


def whole_tests(
    new: dict[str, NDArray[np.float64]], all_cases: Sequence[Case], scatter: Scatter, seeds: Sequence[int]
) -> tuple[list[Found], int, int]:
    """Play whole records: first alarms of each case, false alarms without a change, and repeats without a change."""
    events, found, false, quiet = tuple(new), [], 0, 0
    for seed in seeds:
        random = np.random.default_rng([1, seed])
        monitor = new_monitor(events)
        for repeat in range(BEFORE):
            event = events[repeat % len(events)]
            false += len(monitor.judge(repeat, event, response=measured(new[event], scatter, random)).alarms)
        quiet += BEFORE
        stored = monitor.state(), {event: monitor.baseline(event) for event in events}
        for number, case in enumerate(all_cases):
            random = np.random.default_rng([2, seed, number])
            changed = Monitor.restored(
                SETTINGS, events, channels=CHANNELS, sample_rate=SAMPLE_RATE, state=stored[0], baselines=stored[1]
            )
            found.append(Found(case, first_alarm(changed, case, scatter, random, events)))
    return found, false, quiet


def first_alarm(
    monitor: Monitor, case: Case, scatter: Scatter, random: np.random.Generator, events: Sequence[str]
) -> Alarm | None:
    """Play on with a change until an alarm."""
    for repeat in range(BEFORE, BEFORE + _MOST_REPEATS):
        event = events[repeat % len(events)]
        response = measured(case.response(event, repeat - BEFORE), scatter, random)
        if alarms := monitor.judge(repeat, event, response=response).alarms:
            return alarms[0]
    return None


class MeasureNoise:
    """Measures of the residual that noise alone makes, without records: their distributions in closed form.

    White noise leaves the gain and the phase of a band Gaussian and the energy of the remainder noncentral chi-squared:
    the noise of the mean response, which is the same in all repeats, is what it is centred about.
    """

    def __init__(self, response: NDArray[np.float64], scatter: Scatter, random: np.random.Generator) -> None:
        samples = response.shape[1]
        unit = response.std(axis=1)
        edges = np.ceil(np.array(SETTINGS.bands) * samples / SAMPLE_RATE - 1e-9).astype(int)
        lines = np.fft.rfft(response)[:, edges[0] : edges[-1]] * (2.0 / samples)
        power = np.add.reduceat(np.abs(lines) ** 2, edges[:-1] - edges[0], axis=1)
        self._random, self._scatter = random, scatter
        self._deviation = (scatter.noise * NOISE_RMS / unit / np.sqrt(samples))[:, None]
        self._static = response.mean(axis=1)[:, None] / unit[:, None]
        self._shares = np.sqrt(0.5 * power) / unit[:, None]
        self._freedom = np.broadcast_to(2.0 * np.diff(edges) - 2.0, power.shape)
        self._centre = random.chisquare(self._freedom) / -(-SETTINGS.baseline_repeats // 2)

    def draw(self, repeats: int) -> NDArray[np.float64]:
        """Return measures, shape (repeats, channels, 1 + 3 bands)."""
        shape = (repeats, *self._shares.shape)
        normal = self._random.standard_normal
        scale = self._scatter.gain * normal((repeats, shape[1], 1))
        static = self._deviation * normal((repeats, shape[1], 1)) + scale * self._static
        gain = self._deviation * normal(shape) + scale * self._shares
        phase = self._deviation * normal(shape)
        energy = self._random.noncentral_chisquare(self._freedom, self._centre, shape) * self._deviation**2
        return np.concatenate([static, gain, phase, np.cbrt(energy)], axis=2)


def false_alarms(
    new: dict[str, NDArray[np.float64]],
    scatter: Scatter,
    *,
    seeds: Sequence[int],
    repeats: int,
) -> tuple[int, int]:
    """Count the alarms without a change, and the judged repeats."""
    events, count = tuple(new), 0
    for seed in seeds:
        random = np.random.default_rng([3, seed])
        watch = ChangeWatch(SETTINGS, events, channels=CHANNELS)
        learnt = SETTINGS.baseline_repeats // 2
        drawn = {event: MeasureNoise(new[event], scatter, random).draw(learnt + repeats // 2) for event in events}
        for event in events:
            for measures in drawn[event][:learnt]:
                watch.learn(event, measures)
        for repeat in range(repeats):
            event = events[repeat % 2]
            count += len(watch.judge(repeat, event, drawn[event][learnt + repeat // 2]))
            if repeat % 100 == 0:
                watch.latched[:] = 0
    return count, len(seeds) * repeats


def quiet_row(name: str, count: int, repeats: int) -> list[str]:
    """Tabulate false alarms in 10,000 repeats with the 95 % interval of a Poisson count."""
    low, high = 0.5 * chi2.ppf(0.025, 2 * count) if count else 0.0, 0.5 * chi2.ppf(0.975, 2 * count + 2)
    rate = 1e4 / repeats
    measured_rate = f"{count * rate:.2g} ({low * rate:.2g} to {high * rate:.2g})"
    return [name, f"{repeats:,}", str(count), measured_rate]


def cracks_in_whole_lives(files: dict[str, NDArray[np.float64]], seeds: int) -> list[tuple[Alarm, int]]:
    """Let the axle wear run by run until a tie rod cracks; return the first sudden alarm and when it cracked."""
    first = {event: RIG.playback(drive, seed=0) for event, drive in files.items()}
    for playback in first.values():
        for _ in playback.blocks():
            pass
    damage = np.mean([RIG.worn(WearState(), playback).damage[LINK] for playback in first.values()])
    found, events = [], tuple(files)
    for seed in range(seeds):
        random, monitor = np.random.default_rng([7, seed]), new_monitor(events)
        state, cracked = WearState(damage={LINK: 1.0 - (30.0 + 5.0 * random.uniform()) * damage}), None
        for repeat in range(60):
            if cracked is None and state.damage[LINK] >= 1.0:
                cracked = repeat
            event = events[repeat % len(events)]
            playback = RIG.playback(files[event], seed=1000 * seed + repeat, condition=RIG.condition(state))
            for _ in playback.blocks():
                pass
            state = RIG.worn(state, playback)
            alarms = monitor.judge(repeat, event, response=playback.response).alarms
            sudden = [alarm for alarm in alarms if alarm.kind is AlarmKind.SUDDEN_CHANGE]
            if sudden:
                found.append((sudden[0], -1 if cracked is None else cracked))
                break
    return found


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    new, all_cases = cases(extent.seconds)
    head = [
        "case, repeats differ by",
        "delay, median",
        "90 %",
        "longest",
        "kind right",
        "found first in",
        "change then",
    ]
    rows, quiet_rows, tests = [], [], {}
    for scatter in (SENSORS, ROUGH):
        found, false, quiet = whole_tests(new, all_cases, scatter, range(extent.seeds))
        tests[scatter.name] = found
        rows += [delays_row([each for each in found if each.case is case], scatter) for case in all_cases]
        quiet_rows.append(quiet_row(f"{scatter.name}, whole records", false, quiet))
    counted = false_alarms(new, SENSORS, seeds=range(extent.seeds), repeats=extent.quiet_repeats)
    quiet_rows.append(quiet_row(f"{SENSORS.name}, measures", *counted))
    quiet_head = ["repeats differ by", "repeats", "alarms", "per 10,000 (95 %)"]
    lives = cracks_in_whole_lives(drives(extent.seconds), extent.lives)
    late = [alarm.repeat - cracked + 1 for alarm, cracked in lives]
    places = sorted({alarm.channel for alarm, _ in lives})
    life_row = ["tie rod cracks in a life", str(len(lives)), f"{min(late)} to {max(late)}", ", ".join(places)]
    life_head = ["whole simulations with wear", "lives", "delay", "found first in"]
    figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.4), layout="constrained")
    draw_delays(axes[0], tests, all_cases)
    draw_drift(axes[1], new, all_cases[3], ROUGH)
    draw_noise(axes[2], new, repeats=extent.compared_repeats)
    tables = (markdown_table(head, rows), markdown_table(quiet_head, quiet_rows), markdown_table(life_head, [life_row]))
    return Findings(figure, "\n\n".join(tables))


def delays_row(found: Sequence[Found], scatter: Scatter) -> list[str]:
    """Tabulate the first alarms of one case."""
    case, delays = found[0].case, np.array([each.delay for each in found])
    alarms = [each.alarm for each in found if each.alarm is not None]
    right = sum(alarm.kind is case.kind for alarm in alarms)
    places = [
        f"{alarm.channel}, {alarm.band[0]:g} to {alarm.band[1]:g} Hz" if alarm.band else alarm.channel
        for alarm in alarms
    ]
    usual = max(sorted(set(places)), key=places.count) if places else "–"
    drift = case.kind is AlarmKind.SLOW_DRIFT
    told = [np.quantile(delays, share, method="higher") for share in (0.5, 0.9, 1.0)]
    percent = 100.0 * (_GAIN_DRIFT if "sensor" in case.name else 0.03) * told[0] / _DRIFT_REPEATS
    return [
        f"{case.name}, {scatter.name}",
        *(f"{value:.0f}" if np.isfinite(value) else "not found" for value in told),
        f"{right} of {len(found)}",
        f"{usual} ({places.count(usual)})",
        f"{percent:.2g} %" if drift else "–",
    ]


def draw_delays(axes: Axes, tests: dict[str, list[Found]], all_cases: Sequence[Case]) -> None:
    """Draw the share of tests in which a change is found, over the repeats since it began."""
    for case, colour in zip(all_cases, ("#c0562a", "#8c6bb1", "#1b5e9b", "#3d8b4f"), strict=True):
        for name, style in ((SENSORS.name, "-"), (ROUGH.name, "--")):
            delays = np.sort([each.delay for each in tests[name] if each.case is case])
            share = np.arange(1, delays.size + 1) / delays.size
            axes.step([1, *delays], [0, *share], style, where="post", color=colour, label=f"{case.name}, {name}")
    axes.set_xscale("log")
    axes.set_xlim(0.9, None)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=6.5, loc="lower right")
    label(axes, "changes found", across="repeats since the change began", up="share of the tests")


def draw_drift(axes: Axes, new: dict[str, NDArray[np.float64]], case: Case, scatter: Scatter) -> None:
    """Draw a drift that hides among the repeats, and when it is found."""
    events, monitor, random = tuple(new), new_monitor(tuple(new)), np.random.default_rng(4)
    channel = CHANNELS.index(_DRIFTING_SENSOR)
    repeats, shown, alarm = range(BEFORE + 300), [], None
    for repeat in repeats:
        event = events[repeat % 2]
        response = new[event] if repeat < BEFORE else case.response(event, repeat - BEFORE)
        verdict = monitor.judge(repeat, event, response=measured(response, scatter, random))
        as_it_was = np.sqrt(np.mean(new[event][channel] ** 2))
        shown.append(verdict.statistics.column(Statistic.RMS)[channel] / as_it_was - 1.0)
        alarm = alarm or next((each for each in verdict.alarms if each.channel == _DRIFTING_SENSOR), None)
    axes.plot(repeats, 100.0 * np.array(shown), ".", ms=3.0, color="#7f7f7f", label="RMS of the channel")
    truth = [100.0 * _GAIN_DRIFT * max(0, repeat - BEFORE) / _DRIFT_REPEATS for repeat in repeats]
    axes.plot(repeats, truth, color="#3d8b4f", label="gain of the sensor")
    if alarm is not None:
        axes.axvline(alarm.repeat, color="#c0562a", label=f"alarm: {alarm.kind.value}, since about {alarm.since}")
    axes.legend(fontsize=7, loc="upper left")
    label(axes, f"{case.name}, {scatter.name}", across="repeat", up="change of left_vertical, %")


def draw_noise(axes: Axes, new: dict[str, NDArray[np.float64]], *, repeats: int) -> None:
    """Compare the measures that are drawn with those of whole records: standard deviations of all of them."""
    event = next(iter(new))
    for each, colour in ((SENSORS, "#1b5e9b"), (ROUGH, "#c0562a")):
        whole = whole_measures(new[event], each, repeats)
        drawn = MeasureNoise(new[event], each, np.random.default_rng(6)).draw(repeats)
        axes.loglog(whole.std(axis=0).ravel(), drawn.std(axis=0).ravel(), ".", color=colour, label=each.name)
    ends = np.array(axes.get_xlim())
    axes.loglog(ends, ends, color="0.5", lw=0.8)
    axes.legend(fontsize=7)
    label(axes, "standard deviation of each measure", across="whole records", up="drawn")


def whole_measures(response: NDArray[np.float64], scatter: Scatter, repeats: int) -> NDArray[np.float64]:
    """Return the measures of whole records, shape (repeats, channels, 1 + 3 bands)."""
    random, monitor = np.random.default_rng(5), new_monitor(("event",))
    for repeat in range(SETTINGS.baseline_repeats):
        monitor.judge(repeat, "event", response=measured(response, scatter, random))
    return np.array(
        [
            monitor.judge(repeat, "event", response=measured(response, scatter, random)).statistics.measures
            for repeat in range(SETTINGS.baseline_repeats, SETTINGS.baseline_repeats + repeats)
        ]
    )


if __name__ == "__main__":
    run("detection_of_wear", study)
