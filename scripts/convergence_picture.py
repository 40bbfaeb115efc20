"""Draw docs/pictures/convergence.webp: target and response of one channel, playback after playback, from a recording.

`python scripts/convergence_picture.py [out/demo/recording.mcap] [--channel left_lateral] [--from 20] [--to 24]`
"""

import argparse
import io
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import duralab

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "convergence.webp"
BLUE, GREY, ORANGE = "#1565c0", "#90a4ae", "#ef6c00"
FRAMES_BETWEEN, HOLD_MILLISECONDS, STEP_MILLISECONDS = 5, 900, 60


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, nargs="?", default=Path("out/demo/recording.mcap"))
    parser.add_argument("--channel", default="left_lateral")
    parser.add_argument("--from", dest="begin", type=float, default=20.0, help="start of the shown part, in seconds")
    parser.add_argument("--to", dest="end", type=float, default=24.0, help="end of the shown part, in seconds")
    parser.add_argument("--out", type=Path, default=PICTURE)
    asked = parser.parse_args()
    if not asked.recording.is_file():
        sys.exit(f"There is no recording {asked.recording}; `make demo` writes out/demo/recording.mcap.")
    recording = duralab.open(asked.recording)
    part = slice(asked.begin, asked.end)
    target = recording.target(in_band=True).sel(time=part)[asked.channel].load()
    played = recording.responses(in_band=True).sel(time=part)[asked.channel].load()
    errors = recording.iterations.to_xarray().relative_rms_error.sel(channel=asked.channel).values
    time = target.time.values - asked.begin
    responses = np.vstack([np.zeros_like(target.values), played.transpose("run", "time").values[: errors.size]])
    frames, durations = [], []
    for playback in range(1, responses.shape[0]):
        for step in range(1, FRAMES_BETWEEN + 1):
            share = step / FRAMES_BETWEEN
            response = (1.0 - share) * responses[playback - 1] + share * responses[playback]
            frames.append(_frame(time, target.values, response, errors, asked.channel, playback=playback))
            durations.append(STEP_MILLISECONDS)
        durations[-1] = HOLD_MILLISECONDS
    durations[-1] = 3 * HOLD_MILLISECONDS
    frames[0].save(asked.out, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=60, method=2)


def _frame(
    time: np.ndarray, target: np.ndarray, response: np.ndarray, errors: np.ndarray, channel: str, *, playback: int
) -> Image.Image:
    """Draw one frame: signals on the left, error of each playback until now on the right."""
    with mpl.rc_context({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9.0, 3.4), dpi=100, layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(2.6, 1))
        left.plot(time, target / 1e3, color=GREY, linewidth=3.5, label="target")
        left.plot(time, response / 1e3, color=BLUE, linewidth=1.3, label=f"response, playback {playback}")
        largest = 1.45 * np.abs(target).max() / 1e3
        left.set(xlabel="time in s", ylabel=f"{channel.replace('_', ' ')} force in kN", ylim=(-largest, largest))
        left.legend(loc="upper right", frameon=False, ncols=2)
        right.bar(np.arange(1, playback + 1), 100.0 * errors[:playback], color=ORANGE)
        right.set(
            xlabel="playback",
            ylabel="relative RMS error in %",
            xlim=(0.3, errors.size + 0.7),
            ylim=(0.0, 110.0 * errors.max()),
            xticks=np.arange(1, errors.size + 1),
        )
        right.set_title(f"{100.0 * errors[playback - 1]:.1f} %", color=ORANGE)
        content = io.BytesIO()
        figure.savefig(content, format="png")
    return Image.open(content).convert("RGB")


if __name__ == "__main__":
    main()
