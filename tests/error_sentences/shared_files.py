"""Correct files that a mistake needs beside it, each made once: recordings, signals, settings, certificates."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from duralab import Channel, Signals
from duralab.campaign import load_campaign
from duralab.formats import write_signals
from duralab.security import MemberEntry, init_authority, issue

ROOT: Final = Path(__file__).resolve().parents[2]
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7474"
RESPONSES: Final = tuple(
    f"{side}_{axis}" for side in ("left", "right") for axis in ("vertical", "lateral", "longitudinal")
)
_TEXTS: Final = {
    "map.yaml": """rig: beam
controller: a station
sample_rate: 200
lead: 0.5
drives:
  left: {channel: L Disp, kind: displacement, unit: mm, minimum: -50, maximum: 50, recorded_command: L Cmd}
  right: {channel: R Disp, kind: displacement, unit: mm, minimum: -50, maximum: 50, recorded_command: R Cmd}
responses:
  left_force: {channel: L Force, kind: force, unit: kN, minimum: -20, maximum: 20}
longest_drive: 60
""",
    "weeks.yaml": """name: weeks
rig: front_axle
events:
  rough: {drive: rough.mcap, repeats: 400, missed_target_accepted: true}
  smooth: {drive: smooth.mcap, repeats: 100, missed_target_accepted: true}
""",
    "sweep.yaml": "name: gains\ncampaign: front_axle_demo\naxes: {update.iteration_gain: [0.5, 1.0]}\n",
    "members.yaml": """members:
- {role: router, name: main}
- {role: operator, name: anna}
""",
}


def _synthetic() -> tuple[Any, Any]:
    """The synthetic recordings of the tests of the SDK."""
    folder = str(ROOT / "duralab/tests")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    import synthetic_campaign
    import synthetic_endurance

    return synthetic_campaign, synthetic_endurance


def _signals(*names: str, unit: str = "N", rate: float = 1000.0, peak: float = 100.0) -> Signals:
    time = np.arange(round(4.0 * rate)) / rate
    rows = [peak * np.sin(2.0 * np.pi * (1.0 + 0.5 * number) * time) for number in range(len(names))]
    return Signals(tuple(Channel(name, unit) for name in names), rate, np.stack(rows))


def _campaign_recording(path: Path, *, seed: int = 3, finish: bool = True) -> None:
    campaign, _ = _synthetic()
    campaign.write(path, campaign.steps(campaign.make(seconds=8.0, iterations=3, seed=seed)), finish=finish)


def _without_playbacks(path: Path) -> None:
    campaign, _ = _synthetic()
    campaign.write(path, campaign.steps(campaign.make(seconds=8.0, iterations=3))[:1])


def _damaged(path: Path) -> None:
    _campaign_recording(path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 64] = bytes(64)
    path.write_bytes(content)


def _endurance(path: Path) -> None:
    _, endurance = _synthetic()
    folder = path.with_name("endurance-parts")
    folder.mkdir()
    found = endurance.write(folder, endurance.make(volume_repeats=120))
    shutil.copy(found, path)


def _certificates(path: Path) -> None:
    init_authority(path)
    issue(path, MemberEntry(role="router", name="main"))


def _cut(path: Path) -> None:
    whole = path.with_name("whole.rsp")
    write_signals(_signals("left", "right"), whole)
    path.write_bytes(whole.read_bytes()[:-3000])


def _mdf_of_two_times(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as measurement:
        for name, samples in (("left", 100), ("right", 50)):
            measurement.append([asammdf.Signal(np.ones(samples), np.arange(samples) / 200.0, name=name, unit="N")])
        measurement.save(path, overwrite=True)


def _tdms_of_two_rates(path: Path) -> None:
    import nptdms

    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("g", name, np.ones(5), properties={"wf_increment": step})
                for name, step in (("left", 0.005), ("right", 0.01))
            ]
        )


def _parquet_with_nulls(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"time [s]": [0.0, 1.0], "left [N]": [1.0, None]}), path)


def _mat_without_rate(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {"samples": np.ones((2, 5))})


_MADE: Final[dict[str, Callable[[Path], Any]]] = {
    "recording.mcap": _campaign_recording,
    "rough.mcap": _campaign_recording,
    "smooth.mcap": lambda path: _campaign_recording(path, seed=4),
    "second.mcap": lambda path: _campaign_recording(path, seed=4),
    "empty.mcap": _without_playbacks,
    "damaged.mcap": _damaged,
    "endurance.mcap": _endurance,
    "certificates": _certificates,
    "campaign.yaml": lambda path: path.write_text(load_campaign("front_axle_demo").text, encoding="utf-8"),
    "signals.csv": lambda path: write_signals(_signals("left", "right"), path),
    "target.csv": lambda path: write_signals(_signals(*RESPONSES), path),
    "slow.csv": lambda path: write_signals(_signals(*RESPONSES, rate=500.0), path),
    "strokes.csv": lambda path: write_signals(_signals(*RESPONSES, unit="m", peak=0.001), path),
    "large.csv": lambda path: write_signals(_signals(*RESPONSES, unit="m", peak=3.0), path),
    "beam.drv": lambda path: write_signals(_signals("left", "right", unit="m", rate=200.0, peak=0.01), path),
    "beyond.drv": lambda path: write_signals(_signals("left", "right", unit="m", rate=200.0, peak=0.2), path),
    "cut.rsp": _cut,
    "two_times.mf4": _mdf_of_two_times,
    "two_rates.tdms": _tdms_of_two_rates,
    "nulls.parquet": _parquet_with_nulls,
    "no_rate.mat": _mat_without_rate,
}


class SharedFiles:
    """The files, made in a folder when the first mistake needs them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir()

    def lay_into(self, folder: Path, *, wanted: str, changes: dict[str, dict[str, Any]]) -> None:
        """Copy the files that a text names into a folder, with keys of the YAML files changed."""
        needed = [name for name in (*_MADE, *_TEXTS) if name in f"{wanted} {changes}"]
        text = " ".join(_TEXTS.get(name, "") for name in needed)
        needed += [name for name in _MADE if name in text]
        for name in dict.fromkeys(needed):
            if not (folder / name).exists():
                source = self._made(name)
                (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / name)
        for name, keys in changes.items():
            path = folder / name
            path.write_text(_changed(path.read_text(encoding="utf-8"), keys), encoding="utf-8")

    def _made(self, name: str) -> Path:
        path = self._folder / name
        if not path.exists():
            if name in _TEXTS:
                path.write_text(_TEXTS[name], encoding="utf-8")
            else:
                _MADE[name](path)
        return path


def _changed(text: str, keys: dict[str, Any]) -> str:
    content = yaml.safe_load(text)
    for dotted, value in keys.items():
        *sections, key = dotted.split(".")
        place = content
        for section in sections:
            place = place[section]
        if value is None:
            del place[key]
        else:
            place[key] = value
    return yaml.safe_dump(content, sort_keys=False)
