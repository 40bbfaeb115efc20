"""Figure 7 of the paper: time waveforms of basic TWR and Adaptive Modelling, rig identified while its friction sticks.

`python studies/figure_7.py` writes picture and table of docs/studies/figure_7.md again.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from low_level_campaigns import BAND, LONGITUDINAL
from low_level_comparison import CHANNELS, FULL, QUICK, Extent, drawn_trials, target_of, worst_channel
from matplotlib.figure import Figure
from numpy.typing import NDArray
from study_page import Findings, label, markdown_table, percent, plt, run

from duralab_spectra import relative_rms_error

DRAWN_SECONDS: Final = 1.5


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    return Findings(draw(extent), table(extent))


def shown_samples(extent: Extent) -> slice:
    """Return the stretch in whose middle basic TWR, the first one drawn, is furthest off."""
    count = round(DRAWN_SECONDS * BAND.sample_rate)
    response = drawn_trials(extent)[0][1].iterations[-1].response_in_band
    missed = (target_of(extent) - response)[worst_channel(extent)]
    middle = int(np.argmax(np.abs(missed[count:-count]))) + count
    return slice(middle - count // 2, middle + count // 2)


def draw(extent: Extent) -> Figure:
    """Draw target and response of every algorithm below each other."""
    drawn, target = drawn_trials(extent), target_of(extent)
    channel, shown = worst_channel(extent), shown_samples(extent)
    seconds = np.arange(target.shape[1])[shown] / BAND.sample_rate
    figure, panels = plt.subplots(len(drawn), 1, figsize=(10.5, 6.5), layout="constrained", sharex=True, sharey=True)
    figure.suptitle(f"{CHANNELS[channel]} force in playback {extent.playbacks}, where basic TWR is furthest off")
    for axes, (algorithm, trial) in zip(panels, drawn, strict=True):
        response = trial.iterations[-1].response_in_band[channel, shown]
        axes.plot(seconds, target[channel, shown] / 1e3, color="0.25", lw=2.4, alpha=0.45, label="target")
        axes.plot(seconds, response / 1e3, color=algorithm.colour, lw=1.1, label="response")
        label(axes, algorithm.name, across="", up="force, kN")
        axes.legend(loc="upper right")
    panels[-1].set_xlabel("time, s")
    panels[-1].set_xlim(seconds[0], seconds[-1])
    return figure


def table(extent: Extent) -> str:
    """Write how far the waveforms of the last playback are from the target's."""
    shown, target = shown_samples(extent), target_of(extent)
    rows = []
    for algorithm, trial in drawn_trials(extent):
        response = trial.iterations[-1].response_in_band
        for channel in LONGITUDINAL:
            wanted, measured = target[channel], response[channel]
            rows.append(
                [
                    f"{algorithm.name}, {CHANNELS[channel]}",
                    percent(_error(wanted, measured)),
                    percent(_error(wanted[shown], measured[shown])),
                    f"{np.abs(wanted).max() / 1e3:.2f} kN",
                    f"{np.abs(measured).max() / 1e3:.2f} kN",
                    f"{np.corrcoef(wanted, measured)[0, 1]:.4f}",
                ]
            )
    head = [
        f"playback {extent.playbacks}",
        "relative RMS error",
        "in the stretch drawn",
        "largest force of the target",
        "of the response",
        "correlation",
    ]
    return markdown_table(head, rows)


def _error(wanted: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    return float(relative_rms_error(wanted[None, :], measured[None, :])[0])


if __name__ == "__main__":
    run("figure_7", study)
