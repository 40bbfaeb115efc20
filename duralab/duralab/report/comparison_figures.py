"""Figures that overlay several recordings, each in a separate colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import duralab_spectra
from duralab.analysis import Comparison
from duralab.data import DAMAGE_SLOPES, Model, Playback, Signals, excited_lines
from duralab.report.drawing import (
    Figure,
    axes,
    band_edges,
    channel_color,
    frequency_axis,
    level_line,
    level_note,
    line,
    markers,
    over_playbacks,
)
from duralab.report.load_figures import CountedLoad
from duralab.report.series import encode
from duralab.report.waveforms import SHOWN_BEYOND_BAND, SPECTRUM_OVERLAP, zoom_window
from duralab_loads import count_load_cycles


@dataclass(frozen=True, eq=False)
class Overlaid:
    """Curves of one recording.

    `name`, `color`: Name and colour of the curves. `target`: Target in the control band. `best`: Best playback.
    `model`: Model; None if the recording has none. `band`: Lower and upper edge of the control band, in hertz.
    `block_samples`: Number of samples in a block of the spectra.
    """

    name: str
    color: str
    target: Signals
    best: Playback
    model: Model | None
    band: tuple[float, float]
    block_samples: int


def overlaid(comparison: Comparison) -> list[Overlaid]:
    """Read the data to draw from each recording."""
    return [
        Overlaid(
            name=entry.name,
            color=channel_color(place),
            target=entry.recording.target,
            best=entry.recording.playback(entry.iterations.numbers[entry.iterations.best]),
            model=entry.recording.model,
            band=(entry.recording.specification.lowest_frequency, entry.recording.specification.highest_frequency),
            block_samples=entry.recording.specification.estimator.block_samples,
        )
        for place, entry in enumerate(comparison.recordings)
    ]


def overall_error(comparison: Comparison) -> Figure:
    """Return the figure of the relative RMS error over all channels after every playback of each recording."""
    tables = [(entry.name, entry.iterations.numbers, entry.iterations.overall) for entry in comparison.recordings]
    return _over_playbacks(tables, "relative RMS error, all channels")


def channel_error(comparison: Comparison, channel: str) -> Figure:
    """Return the figure of the relative RMS error of one channel after every playback of each recording."""
    tables = [
        (
            entry.name,
            entry.iterations.numbers,
            entry.iterations.relative_rms_error[:, entry.iterations.channels.index(channel)],
        )
        for entry in comparison.recordings
    ]
    return _over_playbacks(tables, "relative RMS error")


def damage(comparison: Comparison, slope: int) -> Figure:
    """Return the figure of the damage ratio of every channel of each recording after its best playback."""
    column = DAMAGE_SLOPES.index(slope)
    data = [
        {
            "type": "bar",
            "name": name,
            "x": [channel.replace("_", " ") for channel in comparison.channels],
            "y": [
                None if np.isnan(row.damage_ratio[column]) else row.damage_ratio[column]
                for row in comparison.rows
                if row.recording == name
            ],
            "marker": {"color": channel_color(place)},
        }
        for place, name in enumerate(comparison.names)
    ]
    layout = axes(x="", y=f"damage ratio, k = {slope}", barmode="group")
    layout["shapes"], layout["annotations"] = [level_line(1.0)], [level_note(1.0, "target")]
    return {"data": data, "layout": layout}


def waveform(entries: Sequence[Overlaid], channel: str) -> Figure:
    """Return the figure of target and best response of each recording around the largest peak of the first target."""
    first = entries[0]
    window = zoom_window(first.target)
    start, end = window.start / first.target.sample_rate, window.stop / first.target.sample_rate
    data = []
    for place, entry in enumerate(entries):
        rate, row = entry.target.sample_rate, entry.target.names.index(channel)
        part = slice(round(start * rate), round(end * rate))
        grid = {"x0": part.start / rate, "dx": 1 / rate}
        if place == 0:
            data.append(line("target", "@target", width=2.2, y=encode(entry.target.samples[row, part]), **grid))
        response = entry.best.response_in_band.samples[row, part]
        data.append(line(entry.name, entry.color, y=encode(response), **grid))
    unit = first.target.channels[first.target.names.index(channel)].unit
    return {"data": data, "layout": axes(x="time [s]", y=f"[{unit}]")}


def spectrum(entries: Sequence[Overlaid], channel: str) -> Figure:
    """Return the figure of the power spectral density of the first target and of each recording's best response."""
    data = []
    for place, entry in enumerate(entries):
        row = entry.target.names.index(channel)
        if place == 0:
            data.append(_density(entry, entry.target.samples[row], "target", "@target", width=2.2))
        data.append(_density(entry, entry.best.response_in_band.samples[row], entry.name, entry.color))
    first = entries[0]
    unit = first.target.channels[first.target.names.index(channel)].unit
    layout = axes(x="", y=f"[{unit}²/Hz]", shapes=band_edges(first.band))
    layout["xaxis"] = frequency_axis()
    layout["yaxis"] |= {"type": "log", "exponentformat": "power", "dtick": 1}
    return {"data": data, "layout": layout}


def counted(entries: Sequence[Overlaid], channel: str) -> list[CountedLoad]:
    """Count the load cycles of the first recording's target and of the best response of each recording."""
    first = entries[0]
    signals = [("target", "@target", first.target.samples[first.target.names.index(channel)])]
    signals += [
        (entry.name, entry.color, entry.best.response_in_band.samples[entry.target.names.index(channel)])
        for entry in entries
    ]
    return [CountedLoad(name, color, samples, count_load_cycles(samples)) for name, color, samples in signals]


def model_elements(entries: Sequence[Overlaid]) -> list[tuple[str, str]]:
    """Return response and drive names of the elements common to all models; empty if a recording has no model."""
    models = [entry.model for entry in entries if entry.model is not None]
    if len(models) < len(entries):
        return []
    named = [[(y.name, u.name) for y in model.responses for u in model.drives] for model in models]
    return [element for element in named[0] if all(element in others for others in named)]


def model_element(entries: Sequence[Overlaid], response: str, drive: str) -> Figure:
    """Return the figure of magnitude, phase and coherence of one FRF element of each recording."""
    data, title, unit = [], "", ""
    for entry in entries:
        model = entry.model
        if model is None:
            continue
        i = next(i for i, channel in enumerate(model.responses) if channel.name == response)
        j = next(j for j, channel in enumerate(model.drives) if channel.name == drive)
        lines = excited_lines(model)
        element, frequency = model.frf[lines, i, j], encode(model.frequency[lines])
        rows = (
            ("y", np.abs(element)),
            ("y2", np.degrees(np.angle(element))),
            ("y3", model.coherence[lines, i]),
        )
        data += [
            line(entry.name, entry.color, x=frequency, y=encode(values), yaxis=axis, showlegend=False)
            for axis, values in rows
        ]
        title = f"{model.responses[i].title} over {model.drives[j].title}"
        unit = f"{model.responses[i].unit}/{model.drives[j].unit}"
    phase = {"range": [-190, 190], "tickvals": [-180, -90, 0, 90, 180], "title": {"text": "phase [°]"}}
    return {
        "data": data,
        "layout": {
            "title": {"text": title},
            "xaxis": frequency_axis() | {"anchor": "y3"},
            "yaxis": {
                "domain": [0.52, 1.0],
                "type": "log",
                "title": {"text": f"magnitude<br>[{unit}]"},
                "exponentformat": "power",
                "dtick": "D2",
            },
            "yaxis2": {"domain": [0.26, 0.47], **phase},
            "yaxis3": {"domain": [0.0, 0.21], "range": [0, 1.05], "title": {"text": "coherence"}},
            "shapes": band_edges(entries[0].band),
        },
    }


def _over_playbacks(curves: Sequence[tuple[str, Sequence[int], np.ndarray]], title: str) -> Figure:
    longest = max((numbers for _, numbers, _ in curves), key=len)
    layout = over_playbacks(title, longest)
    layout["yaxis"]["rangemode"] = "tozero"
    data = []
    for place, (name, numbers, values) in enumerate(curves):
        # A campaign's name is shown unchanged; a channel's underscores become spaces.
        data.append(markers(place, name, x=numbers, y=values) | {"name": name})
    return {"data": data, "layout": layout}


def _density(entry: Overlaid, samples: np.ndarray, name: str, color: str, *, width: float = 1.4) -> Figure:
    block = min(entry.block_samples, samples.size - samples.size % 2)
    rate = entry.target.sample_rate
    density = duralab_spectra.auto_spectra(
        samples[np.newaxis], block_samples=block, overlap=SPECTRUM_OVERLAP, sample_rate=rate
    )[:, 0]
    frequency = np.arange(block // 2 + 1) * rate / block
    drawn = (frequency >= entry.band[0] / SHOWN_BEYOND_BAND) & (frequency <= entry.band[1] * SHOWN_BEYOND_BAND)
    drawn &= frequency > 0
    # Omit the filter's floor, five decades below, which would dominate the axis.
    drawn &= density > 1e-5 * density[drawn].max(initial=0.0)
    return line(name, color, width=width, x=encode(frequency[drawn]), y=encode(density[drawn]))
