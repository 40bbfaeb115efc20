"""Figure 8 of the paper: spectra of target and responses, and why basic TWR diverges where it does.

`python studies/figure_8.py` writes picture and table of docs/studies/figure_8.md again.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from low_level_campaigns import BAND, OPERATIONAL
from low_level_comparison import (
    CHANNELS,
    FULL,
    QUICK,
    SHARE,
    Extent,
    drawn_trials,
    model_of,
    operational_model,
    target_of,
    worst_channel,
)
from matplotlib.axes import Axes
from numpy.typing import NDArray
from study_page import Findings, label, markdown_table, percent, plain_numbers, plt, run

from duralab_spectra import auto_spectra, line_frequencies
from iterator import overlay_spectra

_SPECTRUM_BLOCK: Final = 2048
#: N²/Hz; below is what the flank of the control band leaves of the target.
_LOWEST_DENSITY: Final = 1.0
#: Frequencies in Hz between which the table shows the error.
BAND_EDGES: Final = (0.7, 5.0, 10.0, 15.0, 18.0, 23.0, 30.0, 35.0)
_MODELS: Final = ("#c0562a", "0.25")


def study(quick: bool) -> Findings:
    """Measure, draw and tabulate."""
    extent = QUICK if quick else FULL
    figure, panels = plt.subplots(1, 3, figsize=(13.0, 4.6), layout="constrained")
    draw_spectra(panels[0], extent)
    draw_models(panels[1], extent)
    draw_radius(panels[2], extent)
    return Findings(figure, f"{bands_table(extent)}\n\n{prediction_told(extent)}")


def draw_spectra(axes: Axes, extent: Extent) -> None:
    """Draw the PSD of the channel that basic TWR leaves worst."""
    channel = worst_channel(extent)
    for number, (algorithm, trial) in enumerate(drawn_trials(extent)):
        overlay = overlay_spectra(
            target_of(extent),
            trial.iterations[-1].response_in_band,
            sample_rate=BAND.sample_rate,
            block_samples=_SPECTRUM_BLOCK,
        )
        seen, f = _in_band(overlay.frequency), overlay.frequency
        if number == 0:
            axes.semilogy(f[seen], overlay.target[seen, channel], color="0.25", lw=2.6, alpha=0.45, label="target")
        axes.semilogy(f[seen], overlay.response[seen, channel], color=algorithm.colour, lw=1.1, label=algorithm.name)
    axes.set_ylim(bottom=_LOWEST_DENSITY)
    label(axes, f"PSD, {CHANNELS[channel]}, playback {extent.playbacks}", across="frequency, Hz", up="N²/Hz")
    axes.legend(loc="best")


def draw_models(axes: Axes, extent: Extent) -> None:
    """Draw that channel's FRF as identified softly and at operational level."""
    channel = worst_channel(extent)
    names = (f"at {100.0 * SHARE:g} % of the operational level", "at operational level")
    for model, colour, name in zip((model_of(extent), operational_model(extent)), _MODELS, names, strict=True):
        seen = _in_band(model.frequency)
        axes.semilogy(model.frequency[seen], np.abs(model.frf[seen, channel, channel]) / 1e6, color=colour, label=name)
    label(axes, f"FRF, {CHANNELS[channel]}, as identified", across="frequency, Hz", up="kN/mm")
    plain_numbers(axes)
    axes.legend(loc="best")


def draw_radius(axes: Axes, extent: Extent) -> None:
    """Draw the prediction of Eq. 6 for every gain."""
    for gain, style in zip(extent.gains, ("-", "--", ":"), strict=False):
        frequency, radius = spectral_radius(extent, gain)
        axes.plot(frequency, radius, style, color="0.25", lw=1.1, label=f"gain {gain:g}")
    axes.axhline(1.0, color="#c0562a", lw=0.8)
    label(axes, "Eq. 6, operational model as the rig", across="frequency, Hz", up="spectral radius")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="best")


def spectral_radius(extent: Extent, gain: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lines of the band and by how much Eq. 6 lets the error grow there from one playback to the next."""
    model = model_of(extent)
    seen = _in_band(model.frequency)
    product = operational_model(extent).frf[seen] @ model.inverse_frf[seen]
    radius = np.abs(np.linalg.eigvals(np.eye(OPERATIONAL.size) - gain * product)).max(axis=1)
    return model.frequency[seen], radius


def bands_table(extent: Extent) -> str:
    """Write where in frequency the error of the worst channel lies."""
    channel, target = worst_channel(extent), target_of(extent)
    frequency = line_frequencies(_SPECTRUM_BLOCK, BAND.sample_rate)
    wanted = _density(target[channel])
    head = [f"{CHANNELS[channel]}, playback {extent.playbacks}: RMS error over that of the target within"]
    head += [f"{low:g} to {high:g} Hz" for low, high in pairwise(BAND_EDGES)]
    rows = []
    for algorithm, trial in drawn_trials(extent):
        missed = _density(target[channel] - trial.iterations[-1].response_in_band[channel])
        row = [algorithm.name]
        for low, high in pairwise(BAND_EDGES):
            within = (frequency >= low) & (frequency < high)
            row.append(percent(float(np.sqrt(missed[within].sum() / wanted[within].sum()))))
        rows.append(row)
    return markdown_table(head, rows)


def prediction_told(extent: Extent) -> str:
    """Say by how much Eq. 6 lets the error grow where the rig is the one of the operational level."""
    told = []
    for gain in extent.gains:
        frequency, radius = spectral_radius(extent, gain)
        worst = int(np.argmax(radius))
        told.append(f"{radius[worst]:.2f} at {frequency[worst]:.1f} Hz with gain {gain:g}")
    return (
        f"Spectral radius of Eq. 6, the operational model standing for the rig, at its worst line: {'; '.join(told)}."
    )


def _density(record: NDArray[np.float64]) -> NDArray[np.float64]:
    return auto_spectra(record[None, :], block_samples=_SPECTRUM_BLOCK, overlap=0.5, sample_rate=BAND.sample_rate)[:, 0]


def _in_band(frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (frequency >= BAND.lowest) & (frequency <= BAND.highest)


if __name__ == "__main__":
    run("figure_8", study)
