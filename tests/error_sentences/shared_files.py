"""Correct files that a mistake needs beside it, each made once: recordings, signals, settings, certificates."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import yaml
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ed25519

from duralab import Channel, Signals
from duralab.campaign import load_campaign
from duralab.formats import export_drive, import_response, read_signals, write_signals
from duralab.security import MemberEntry, init_authority, issue
from duralab_proto.arrays import from_array, to_array

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


def _of_another_rig(path: Path) -> None:
    campaign, _ = _synthetic()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "NAMES", tuple(name.replace("left", "front") for name in campaign.NAMES))
        patch.setattr(campaign, "NAMES", tuple(name.replace("right", "rear") for name in campaign.NAMES))
        _campaign_recording(path)


def _without_some_lines(path: Path) -> None:
    """A recording whose model was not identified at some lines inside its band."""
    campaign, _ = _synthetic()
    made = campaign.make(seconds=8.0, iterations=3)
    frf = from_array(made.model.frf).copy()
    frf[100:110] = np.nan
    made.model.frf.CopyFrom(to_array(frf))
    campaign.write(path, campaign.steps(made))


def _endurance(path: Path) -> None:
    _, endurance = _synthetic()
    folder = path.with_name("endurance-parts")
    folder.mkdir()
    found = endurance.write(folder, endurance.make(volume_repeats=120))
    shutil.copy(found, path)


def _certificates(path: Path) -> None:
    init_authority(path)
    issue(path, MemberEntry(role="router", name="main"))


def _authorities(path: Path) -> None:
    """Authorities without their key, with a text in its place, and with a key of another kind."""
    other = ed25519.Ed25519PrivateKey.generate().private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    for name, key in (("without_key", None), ("with_text", b"a text"), ("with_other_key", other)):
        file = init_authority(path / name).key
        file.unlink()
        if key is not None:
            file.write_bytes(key)


def _station(path: Path) -> None:
    """An exchange with a controller: run one was answered, and its drive file changed since; run two waits."""
    path.mkdir()
    controller_map = path / "controller.yaml"
    controller_map.write_text(_TEXTS["map.yaml"], encoding="utf-8")
    spectrum = np.zeros((2, 601), dtype=complex)
    spectrum[:, 3:60] = np.exp(2j * np.pi * np.random.default_rng(1).random((2, 57)))
    drive = Signals((Channel("left", "m"), Channel("right", "m")), 200.0, np.fft.irfft(spectrum))
    played = read_signals(export_drive(drive, controller_map, run="one").path)
    channels = (Channel("L Cmd", "mm"), Channel("R Cmd", "mm"), Channel("L Force", "kN"))
    recorded = np.vstack([played.samples, 0.1 * played.samples[:1]])
    write_signals(Signals(channels, 200.0, recorded), path / "one.rsp")
    import_response(path / "one.rsp", controller_map)
    changed = path / "exchange/outbox/done/one.drv"
    changed.write_bytes(changed.read_bytes()[:-1] + b"\1")
    export_drive(drive, controller_map, run="two")


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


def _mdf_of_texts(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as measurement:
        measurement.append([asammdf.Signal(np.array([b"on", b"off"]), np.arange(2.0), name="state", encoding="utf-8")])
        measurement.save(path, overwrite=True)


def _mdf_of_version_3(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="3.30") as measurement:
        measurement.append([asammdf.Signal(np.ones(100), np.arange(100) / 200.0, name="left", unit="N")])
        measurement.save(path.with_suffix(".mdf"), overwrite=True)
    path.with_suffix(".mdf").rename(path)


def _shortened(path: Path) -> None:
    write_signals(_signals("left", "right"), path)
    path.write_bytes(path.read_bytes()[:-3000])


def _tdms(path: Path, **of_the_second: Any) -> None:
    """A TDMS file of two channels with properties of the second changed."""
    import nptdms

    properties = {"wf_increment": 0.005}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("g", "left", np.ones(5), properties=properties),
                nptdms.ChannelObject("g", "right", np.ones(5), properties=properties | of_the_second),
            ]
        )


def _mdf_of_invalid_samples(path: Path) -> None:
    import asammdf

    time = np.arange(100) / 200.0
    with asammdf.MDF(version="4.10") as measurement:
        measurement.append([asammdf.Signal(np.ones(100), time, name="left", unit="N", invalidation_bits=time > 0.3)])
        measurement.save(path, overwrite=True)


def _parquet(path: Path, **columns: Any) -> None:
    """A Parquet table of two rows with columns changed."""
    import pyarrow
    import pyarrow.parquet

    content = {"time": [0.0, 1.0], "left": [1.0, 2.0], **columns}
    table = pyarrow.table({"time [s]": content["time"], "left [N]": content["left"]})
    pyarrow.parquet.write_table(table, path)


def _parquet_of_too_few_rows(path: Path) -> None:
    """The number of rows at the end of the file, 4000 as a variable-length integer, is one too many."""
    write_signals(_signals("left"), path)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"\x16\xc0\x3e", b"\x16\xc2\x3e", 1))


def _mat(path: Path, **changes: Any) -> None:
    """A MATLAB file of two channels with variables changed; None leaves one out."""
    import scipy.io

    names, units = np.array(["left", "right"], dtype=object), np.array(["N", "N"], dtype=object)
    content = {"samples": np.ones((2, 5)), "sample_rate": 200.0, "names": names, "units": units, **changes}
    scipy.io.savemat(path, {name: value for name, value in content.items() if value is not None})


def _mat_of_many(path: Path) -> None:
    _mat(path)
    announced, large = (np.array([2, samples], dtype="<i4").tobytes() for samples in (5, 1 << 30))
    path.write_bytes(path.read_bytes().replace(announced, large))


_MADE: Final[dict[str, Callable[[Path], Any]]] = {
    "recording.mcap": _campaign_recording,
    "rough.mcap": _campaign_recording,
    "smooth.mcap": lambda path: _campaign_recording(path, seed=4),
    "second.mcap": lambda path: _campaign_recording(path, seed=4),
    "empty.mcap": _without_playbacks,
    "damaged.mcap": _damaged,
    "other_rig.mcap": _of_another_rig,
    "lines_missing.mcap": _without_some_lines,
    "endurance.mcap": _endurance,
    "certificates": _certificates,
    "authorities": _authorities,
    "station": _station,
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
    "two_rates.tdms": lambda path: _tdms(path, wf_increment=0.01),
    "two_starts.tdms": lambda path: _tdms(path, wf_start_offset=5.0),
    "milliseconds.tdms": lambda path: _tdms(path, wf_xunit_string="ms"),
    "invalid.mf4": _mdf_of_invalid_samples,
    "nulls.parquet": lambda path: _parquet(path, left=[1.0, None]),
    "time_of_day.parquet": lambda path: _parquet(path, time=np.array([0, 5], dtype="datetime64[ms]")),
    "rows_missing.parquet": _parquet_of_too_few_rows,
    "texts.mf4": _mdf_of_texts,
    "version_3.mf4": _mdf_of_version_3,
    "cut.tdms": _shortened,
    "cut.uff": _shortened,
    "no_rate.mat": lambda path: _mat(path, sample_rate=None, names=None, units=None),
    "rate_0.mat": lambda path: _mat(path, sample_rate=0.0),
    "one_name.mat": lambda path: _mat(path, names=np.array(["left"], dtype=object)),
    "two_lines.mat": lambda path: _mat(path, names=np.array(["left\nfront", "right"], dtype=object)),
    "huge.mat": _mat_of_many,
    "many.csv": lambda path: write_signals(_signals(*(f"gauge_{number}" for number in range(300)), rate=4.0), path),
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
