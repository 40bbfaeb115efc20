"""How rigs, signals and playbacks look."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.showing.charts import Axis, Curve, line_chart
from duralab.showing.tables import html_table, text_table

if TYPE_CHECKING:
    from duralab.played import Played
    from duralab.recording_content import ActuatorUse, Playback
    from duralab.rig import Rig
    from duralab.signals import Channel, Signals

MOST_CHARTS: Final = 8
"""Channels that are drawn; a page with more is no glance any more."""


def limits_in_words(channel: Channel) -> str:
    """Return the allowed range of a channel, e.g. "± 0.1 m"."""
    if not np.isfinite([channel.minimum, channel.maximum]).all():
        return "–"
    if channel.minimum == -channel.maximum:
        return f"± {channel.maximum:g} {channel.unit}"
    return f"{channel.minimum:g} … {channel.maximum:g} {channel.unit}"


_RIG: Final = ("", "channel", "limits", "rate limit", "what it is")


def _rig_rows(rig: Rig) -> list[tuple[str, ...]]:
    rows = []
    for kind, channels in (("drive", rig.drives), ("response", rig.responses)):
        for channel in channels:
            slew = f"{channel.slew_limit:g} {channel.unit}/s" if channel.slew_limit else "–"
            rows.append((kind, channel.name, limits_in_words(channel), slew, channel.label))
    return rows


def _rig_title(rig: Rig) -> str:
    return (
        f"{rig.name}: {rig.specimen}; {rig.sample_rate:g} Hz, drives up to {rig.longest_drive_seconds:g} s, engine "
        f"{rig.engine} {rig.version}"
    )


def rig_text(rig: Rig) -> str:
    """Return a rig's channels as text."""
    return f"{_rig_title(rig)}\n{text_table(_RIG, _rig_rows(rig), left=len(_RIG))}"


def rig_html(rig: Rig) -> str:
    """Return a rig's channels as HTML."""
    return html_table(_RIG, _rig_rows(rig), left=len(_RIG), caption=_rig_title(rig))


_RIGS: Final = ("rig", "specimen", "engine", "drives", "responses", "sample rate")


def _rigs_rows(rigs: Sequence[Rig]) -> list[tuple[str, ...]]:
    return [
        (rig.name, rig.specimen, rig.engine, str(len(rig.drives)), str(len(rig.responses)), f"{rig.sample_rate:g} Hz")
        for rig in rigs
    ]


def rigs_text(rigs: Sequence[Rig]) -> str:
    """Return a line for each rig."""
    return text_table(_RIGS, _rigs_rows(rigs), left=3) if rigs else "There is no rig in this lab."


def rigs_html(rigs: Sequence[Rig]) -> str:
    """Return the same as HTML."""
    return html_table(_RIGS, _rigs_rows(rigs), left=3) if rigs else "<p>There is no rig in this lab.</p>"


_SIGNALS: Final = ("channel", "unit", "smallest", "largest", "RMS")


def _signals_rows(signals: Signals) -> list[tuple[str, ...]]:
    return [
        (channel.name, channel.unit, *(f"{value:.4g}" for value in (row.min(), row.max(), np.sqrt(np.mean(row**2)))))
        if row.size
        else (channel.name, channel.unit, "–", "–", "–")
        for channel, row in zip(signals.channels, signals.samples, strict=True)
    ]


def _signals_title(signals: Signals) -> str:
    return f"{signals.samples.shape[-1]} samples at {signals.sample_rate:g} Hz, {signals.duration:g} s"


def signals_text(signals: Signals) -> str:
    """Return smallest, largest and RMS value of each channel as text."""
    return f"{_signals_title(signals)}\n{text_table(_SIGNALS, _signals_rows(signals), left=2)}"


def signals_html(signals: Signals) -> str:
    """Return the same as HTML, with the waveforms."""
    table = html_table(_SIGNALS, _signals_rows(signals), left=2, caption=_signals_title(signals))
    return table + "".join(waveforms(signals))


def waveforms(*signals: Signals, names: Sequence[str] = ("",)) -> list[str]:
    """Return a chart of every channel, signals with the same channels over one another.

    Parameters
    ----------
    *signals : Signals
        One or more.
    names : sequence of str
        Of each of them, for the legend.
    """
    first = signals[0]
    charts = [
        line_chart(
            [Curve(name, each.time, each.samples[row]) for name, each in zip(names, signals, strict=True)],
            x=Axis("time [s]"),
            y=Axis(f"[{channel.unit or '–'}]"),
            title=channel.title,
            height=150,
        )
        for row, channel in enumerate(first.channels[:MOST_CHARTS])
    ]
    if (more := len(first.channels) - MOST_CHARTS) > 0:
        charts.append(f"<p>and {more} channels more, not drawn</p>")
    return charts


_USE: Final = ("actuator", "peak of its limit", "saturated", "largest following error")


def _use_rows(uses: Sequence[ActuatorUse]) -> list[tuple[str, ...]]:
    return [
        (
            use.drive,
            f"{use.peak_command_ratio:.0%}",
            f"{use.saturated_share:.2%} of the time" if use.tells_of_a_valve else "–",
            f"{use.largest_following_error:.3g}" if use.tells_what_was_achieved else "–",
        )
        for use in uses
    ]


def _played_title(played: Played) -> str:
    return f"{played.run}, {played.real_time_factor:.0f} times as fast as real time"


def played_text(played: Played) -> str:
    """Return responses and use of the actuators as text."""
    use = text_table(_USE, _use_rows(played.actuators), left=1)
    return f"{_played_title(played)}\n{signals_text(played.response)}\n\n{use}"


def played_html(played: Played) -> str:
    """Return the same as HTML, with the waveforms."""
    use = html_table(_USE, _use_rows(played.actuators), left=1)
    return f"<p>{escape(_played_title(played))}</p>{use}{signals_html(played.response)}"


def playback_text(playback: Playback) -> str:
    """Return one playback of a campaign as text."""
    use = text_table(_USE, _use_rows(playback.actuators), left=1)
    return f"playback {playback.number}, {playback.run}\n{signals_text(playback.response)}\n\n{use}"


def playback_html(playback: Playback) -> str:
    """Return the same as HTML, with the waveforms."""
    use = html_table(_USE, _use_rows(playback.actuators), left=1)
    title = f"<p>playback {playback.number}, {escape(playback.run)}</p>"
    return f"{title}{use}{signals_html(playback.response)}"
