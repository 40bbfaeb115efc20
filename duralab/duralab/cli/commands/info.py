"""`duralab info`: what a file of signals or a recording holds."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from duralab.cli.options import InputFormat, Json
from duralab.cli.output import Output
from duralab.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from duralab.analysis import ChannelSummary, SignalSummary
    from duralab.data import Signals
    from duralab.recording import Recording

_BLOCKS: Final = " ▁▂▃▄▅▆▇█"
_BLOCK_DB: Final = 6.0
_NONE: Final = "–"


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of signals, or a recording.mcap.")],
    *,
    from_format: InputFormat = None,
    as_json: Json = False,
) -> None:
    """Show the content of a signal file or a recording: channels, range, RMS, spectrum; campaign and playbacks."""
    from duralab.analysis import summarize
    from duralab.formats import LEFT_OUT, read_signals
    from duralab.output_files import recording_in
    from duralab.recording import open_recording

    output, file = Output(as_json), recording_in(file)
    if file.suffix.lower() == ".mcap" and from_format is None:
        recording = open_recording(file)
        parts = {name: summarize(signals) for name, signals in _parts(recording).items()}
        if not output.document(_recording_document(recording, parts)):
            output.say(*_recording_lines(recording), *_part_lines(parts))
        return
    signals = read_signals(file, format=from_format)
    summary = summarize(signals)
    if not output.document({"file": file, **_document(summary), "attributes": dict(signals.attributes)}):
        omitted = [signals.attributes[LEFT_OUT]] if LEFT_OUT in signals.attributes else []
        output.say(str(file), *_summary_lines(summary), *omitted)


def _parts(recording: Recording) -> dict[str, Signals]:
    """Return the signals of a recording that are shown: its target, and drive and response of its last playback."""
    parts: dict[str, Signals] = {}
    # A campaign may end before its target is made.
    with suppress(InputError):
        parts["target"] = recording.target
    if numbers := recording.iterations.numbers:
        last = recording.playback(int(numbers[-1]))
        parts |= {"drive": last.drive, "response": last.response}
    return parts


def _recording_lines(recording: Recording) -> list[str]:
    specification, status = recording.specification, recording.status
    lines = [
        f"{recording.path}: campaign {specification.id} on rig {specification.rig}",
        f"ended: {status.activity}" if status is not None else "ended: not in this recording",
        f"runs: {', '.join(recording.runs) or 'none'}",
    ]
    if len(recording.files) > 1:
        lines.append(f"files: {', '.join(map(str, recording.files))}")
    if not recording.whole:
        lines.append("The recording was never finished; it is shown as far as it was written.")
    if len(recording.iterations):
        lines += ["", *str(recording.iterations).splitlines()]
    return lines


def _part_lines(parts: dict[str, SignalSummary]) -> list[str]:
    titles = {
        "target": "Target, in the control band",
        "drive": "Drive of the last playback",
        "response": "Response of the last playback",
    }
    lines = []
    for name, summary in parts.items():
        lines += ["", f"{titles[name]}:", *_summary_lines(summary)]
    return lines


def _recording_document(recording: Recording, parts: dict[str, SignalSummary]) -> dict[str, object]:
    iterations, status = recording.iterations, recording.status
    return {
        "file": recording.path,
        "files": recording.files,
        "whole": recording.whole,
        "campaign": recording.specification.id,
        "rig": recording.specification.rig,
        "ended": None if status is None else status.activity,
        "runs": recording.runs,
        "playbacks": iterations.numbers,
        "overall_error": iterations.overall,
        "signals": {name: _document(summary) for name, summary in parts.items()},
    }


def _summary_lines(summary: SignalSummary) -> list[str]:
    from duralab.analysis import ENERGY_SHARE
    from duralab.display import text_table

    headings = ("channel", "unit", "smallest", "largest", "RMS", f"{100 * ENERGY_SHARE:.0f} % of energy", "PSD")
    count = len(summary.channels)
    lines = [
        f"{count} channel{'' if count == 1 else 's'}, {summary.samples} samples at {summary.sample_rate:g} Hz, "
        f"{summary.duration:.6g} s",
        *text_table(headings, [_row(channel) for channel in summary.channels], left=2).splitlines(),
    ]
    if summary.psd_edges.size:
        first, last = summary.psd_edges[[0, -1]]
        lines.append(
            f"PSD from {first:.3g} to {last:.4g} Hz on a logarithmic axis, one block per {_BLOCK_DB:g} dB below the "
            f"channel's largest, without the mean; lines {summary.resolution:.3g} Hz apart."
        )
    lines += [
        f"{channel.name}: {channel.not_finite} samples are not finite and left out."
        for channel in summary.channels
        if channel.not_finite
    ]
    return lines


def _row(channel: ChannelSummary) -> tuple[str, ...]:
    figures = (f"{value:.4g}" for value in (channel.minimum, channel.maximum, channel.rms))
    if channel.band is None:
        return channel.name, channel.unit or _NONE, *figures, _NONE, _NONE
    low, high = channel.band
    return channel.name, channel.unit or _NONE, *figures, f"{low:.3g} … {high:.4g} Hz", _blocks(channel.psd)


def _blocks(psd: np.ndarray) -> str:
    """Return a density as a row of blocks; shape (columns)."""
    import numpy as np

    with np.errstate(divide="ignore"):
        below = 10.0 * np.log10(psd.max() / psd) / _BLOCK_DB
    full = len(_BLOCKS) - 1
    return "".join(_BLOCKS[full - int(min(steps, full))] for steps in below)


def _document(summary: SignalSummary) -> dict[str, object]:
    return {
        "sample_rate": summary.sample_rate,
        "samples": summary.samples,
        "seconds": summary.duration,
        "psd_resolution": summary.resolution,
        "psd_edges": summary.psd_edges,
        "channels": [asdict(channel) for channel in summary.channels],
    }
