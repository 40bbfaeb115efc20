"""Twenty wrong campaigns: each is refused before the rig moves for its target, or ends within stated bounds."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import duralab
from duralab.errors import InputError, LabError

SIDES = ("left", "right")
AXES = ("vertical", "lateral", "longitudinal")
RESPONSES = [f"{side}_{axis}" for side in SIDES for axis in AXES]
DAMAGE_BOUND = 250.0
"""Default of damage_bound, in passes of the target."""


@dataclass(frozen=True)
class Wrong:
    """A mistake in a campaign: in the file's channels, by response, in other keys, or in the file's sample rate."""

    what: str
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    document: dict[str, Any] = field(default_factory=dict)
    rate: float = 1000.0
    refused: bool = True


def every(axes: tuple[str, ...] = AXES, **change: Any) -> dict[str, dict[str, Any]]:
    return {f"{side}_{axis}": change for side in SIDES for axis in axes}


def swapped(one: str, other: str) -> dict[str, dict[str, Any]]:
    return {
        f"{side}_{axis}": {"from": f"{side}_{source}"}
        for side in SIDES
        for axis, source in ((one, other), (other, one))
    }


WRONG = (
    Wrong("unit: kN on one vertical in newtons", {"left_vertical": {"unit": "kN"}}),
    Wrong("unit: kN on all channels in newtons", every(unit="kN")),
    Wrong("unit: MN on a lateral", {"right_lateral": {"unit": "MN"}}),
    Wrong("unit: mN on all channels", every(unit="mN"), refused=False),
    Wrong("kilograms-force taken for newtons, twice", every(scale=9.80665**2)),
    Wrong("verticals ten times too large", every(("vertical",), scale=10.0)),
    Wrong("laterals a hundred times too large", every(("lateral",), scale=100.0)),
    Wrong("longitudinals a hundred times too large", every(("longitudinal",), scale=100.0)),
    Wrong("pound-force taken for newtons twice", every(scale=4.44822**2)),
    Wrong("one vertical with its sign turned", {"left_vertical": {"scale": -1.0}}, refused=False),
    Wrong("all signs turned", every(scale=-1.0), refused=False),
    Wrong("laterals with their signs turned", every(("lateral",), scale=-1.0), refused=False),
    Wrong("vertical and lateral swapped", swapped("vertical", "lateral"), refused=False),
    Wrong("lateral and longitudinal swapped", swapped("lateral", "longitudinal"), refused=False),
    Wrong("one vertical for all six responses", {name: {"from": "left_vertical"} for name in RESPONSES}, refused=False),
    Wrong("a file of 1000 Hz taken for 4000 Hz", rate=4000.0, refused=False),
    Wrong("a file of 1000 Hz taken for 250 Hz", rate=250.0, refused=False),
    Wrong("another rig, with other channels", document={"rig": "aerospace"}),
    Wrong("the target of a lorry, twelve times the forces", every(scale=12.0)),
    Wrong("the target of a model car, a fiftieth of the forces", every(scale=0.02), refused=False),
)


@dataclass
class Row:
    """What a wrong campaign did to the rig."""

    what: str
    drive: float = 0.0
    force: float = 0.0
    damages: list[float] = field(default_factory=list)
    sentence: str = ""

    @property
    def playbacks(self) -> int:
        return len(self.damages)


@pytest.fixture(scope="module")
def measured(lab, short_document, tmp_path_factory) -> np.ndarray:
    """The target of the right campaign, as measured on the predecessor; shape (responses, samples)."""
    folder = tmp_path_factory.mktemp("right")
    document = deepcopy(short_document) | {"name": "right"}
    document["stop"]["iterations"] = 1
    path = folder / "right.yaml"
    path.write_text(yaml.safe_dump(document))
    target = lab.run(path, out=folder).recording.target(in_band=False)
    return np.stack([target[name].values for name in RESPONSES])


@pytest.fixture(scope="module")
def table(request) -> Iterator[list[Row]]:
    rows: list[Row] = []
    yield rows
    lines = [f"{'campaign':<55} {'drive':>6} {'force':>6} {'damage':>8}  sentence"]
    lines += [
        f"{row.what:<55} {row.drive:>6.2f} {row.force:>6.2f} {sum(row.damages):>8.3g}  {row.sentence}" for row in rows
    ]
    lines += ["drive: largest, of its limit; force: largest, of its range; damage: passes of the target at k = 5"]
    # Not captured: the table is what a person reads of this test.
    with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        sys.stdout.write("\n".join(("", *lines, "")))


def write(path: Path, samples: np.ndarray, rate: float) -> None:
    header = ",".join(["time [s]", *(f"{name} [N]" for name in RESPONSES)])
    rows = np.vstack([np.arange(samples.shape[1]) / rate, samples]).T
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.mark.parametrize("wrong", WRONG, ids=[wrong.what.replace(" ", "_") for wrong in WRONG])
def test_a_wrong_campaign_does_not_move_the_rig_beyond_its_bounds(
    lab, wrong: Wrong, measured, table, short_document, tmp_path: Path
):
    write(tmp_path / "target.csv", measured, wrong.rate)
    number = WRONG.index(wrong)
    document = deepcopy(short_document) | {"name": f"wrong-{number}"} | wrong.document
    channels = {name: {"from": name} | wrong.channels.get(name, {}) for name in RESPONSES}
    document["target"] = {"file": "target.csv", "channels": channels}
    if wrong.rate != 1000.0:
        document["target"]["edit"] = [{"resample": {"rate": 1000}}]
    path = tmp_path / "wrong.yaml"
    path.write_text(yaml.safe_dump(document))
    row = Row(wrong.what)
    table.append(row)
    out = tmp_path / "out"
    try:
        result = lab.run(path, out=out)
        row.sentence = result.verdict.sentence
    except LabError as error:
        row.sentence = str(error)
        if isinstance(error, InputError):
            assert not list(out.rglob("*.mcap"))
    state = lab.state("front_axle_compliant")
    assert state.resting, state
    for recording in map(duralab.open, out.rglob("recording.mcap")):
        figures(row, recording)
    if wrong.refused:
        # Nothing was played for the target: an identification at most, which the campaign states.
        assert row.playbacks == 0, row
    # Drives hold the rig's limits, forces the sensors' ranges, and a playback that passes a bound is the last one.
    assert row.drive <= 1.0
    assert row.force <= 1.0
    assert all(damage <= DAMAGE_BOUND for damage in row.damages[:-1])
    assert row.sentence.endswith((".", "?"))


def figures(row: Row, recording: duralab.Recording) -> None:
    """Fill in what the playbacks did."""
    limits = {channel.name: channel for channel in recording.rig.drives}
    ranges = {channel.name: channel for channel in recording.rig.responses}
    table = recording.iterations
    row.damages = [float(np.max(ratio[:, 1])) for ratio in table.damage_ratio]
    for number in range(1, len(table) + 1):
        playback = recording.playback(number)
        for bounds, signals, what in ((limits, playback.drive, "drive"), (ranges, playback.response, "force")):
            for channel, samples in zip(signals.channels, signals.samples, strict=True):
                stated = bounds[channel.name]
                share = max(samples.max() / stated.maximum, samples.min() / stated.minimum)
                setattr(row, what, max(getattr(row, what), float(share)))
