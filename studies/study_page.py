"""What the studies of docs/studies share: their options, their look, and the way a page gets its figures and table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from marked_numbers import between_markers

from duralab_settings import EstimatorKind, ExcitationKind

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

# Element names of an SVG are random unless salted; the same study writes the same bytes.
mpl.rcParams.update({"svg.hashsalt": "duralab", "svg.fonttype": "none", "font.size": 9.0, "axes.titlesize": 10.0})

STUDIES = Path(__file__).resolve().parents[1] / "docs" / "studies"

TITLES = {
    ExcitationKind.PURE_RANDOM: "pure random",
    ExcitationKind.BURST_RANDOM: "burst random",
    ExcitationKind.SWEPT_SINE: "swept sine",
    ExcitationKind.PSEUDO_RANDOM: "independent phases",
    ExcitationKind.HADAMARD: "Hadamard",
    ExcitationKind.ORTHOGONAL_DFT: "orthogonal DFT",
    ExcitationKind.RANDOM_ORTHOGONAL: "random orthogonal",
}
COLOURS = {
    ExcitationKind.PURE_RANDOM: "#c0562a",
    ExcitationKind.BURST_RANDOM: "#8c6bb1",
    ExcitationKind.SWEPT_SINE: "#7f7f7f",
    ExcitationKind.PSEUDO_RANDOM: "#d9a441",
    ExcitationKind.HADAMARD: "#1b5e9b",
    ExcitationKind.ORTHOGONAL_DFT: "#55a7c9",
    ExcitationKind.RANDOM_ORTHOGONAL: "#3d8b4f",
}
ESTIMATORS = {
    EstimatorKind.H1: "H1",
    EstimatorKind.LOCAL_POLYNOMIAL: "LPM",
    EstimatorKind.LOCAL_RATIONAL: "LRM",
}


@dataclass(frozen=True)
class Findings:
    """What a study writes: a picture and a table in Markdown."""

    figure: Figure
    table: str


def run(name: str, study: Callable[[bool], Findings]) -> None:
    """Run a study from the command line and write its picture and its table.

    Parameters
    ----------
    name
        Of its page, its picture and its script, without suffix.
    study
        Told whether to be quick; then its figures mean nothing and only show that it runs.
    """
    parser = argparse.ArgumentParser(description=f"Write {name}.md, {name}.png and {name}.svg.")
    parser.add_argument("--out", type=Path, default=STUDIES, help="folder to write into; docs/studies by default")
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes, for a test; needs --out")
    asked = parser.parse_args()
    if asked.quick and asked.out.resolve() == STUDIES:
        parser.error("--quick writes figures that mean nothing; give --out with a folder other than docs/studies.")
    asked.out.mkdir(parents=True, exist_ok=True)
    write(name, study(asked.quick), asked.out)


def write(name: str, findings: Findings, folder: Path) -> None:
    """Write page and picture into a folder; the words of the page come from docs/studies."""
    # Neither picture may say when it was written or by which version.
    findings.figure.savefig(folder / f"{name}.png", dpi=110, metadata={"Software": None})
    findings.figure.savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
    plt.close(findings.figure)
    text = (STUDIES / f"{name}.md").read_text(encoding="utf-8")
    written = between_markers(text, findings.table, script=Path(f"{name}.py"))
    (folder / f"{name}.md").write_text(written, encoding="utf-8")


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table; the first column is text, the others figures."""
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def percent(ratio: float) -> str:
    """Write a share with three significant digits."""
    return f"{100.0 * ratio:.3g} %"


def plain_numbers(*all_axes: Axes) -> None:
    """Give logarithmic upright axes one range, with plain numbers at the ticks."""
    limits = np.array([axes.get_ylim() for axes in all_axes])
    for axes in all_axes:
        axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
        axes.yaxis.set_major_formatter("{x:g}")
        if limits[:, 1].max() < 30.0 * limits[:, 0].min():
            axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 3.0, 5.0)))
            axes.yaxis.set_minor_formatter("{x:g}")


def label(axes: Axes, title: str, *, across: str, up: str) -> None:
    """Write what a picture shows, and a grid behind it."""
    axes.set_title(title)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.set_axisbelow(True)
    axes.grid(visible=True, color="0.9")
