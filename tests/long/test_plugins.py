"""Plug-ins by entry points: an installed distribution brings an update, a format and a rig to a real lab."""

from __future__ import annotations

import socket
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml

import duralab
from duralab.formats import read_signals, write_signals
from duralab_bus import BusConfig, ConfigError, open_bus
from duralab_gateway import rig_plugin

MODULE = '''
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from duralab import Channel, Signals
from duralab.formats import FormatPlugin, Written
from duralab_proto.v1 import array_pb2, rig_pb2
from iterator import NextDrive, apply_inverse


class Momentum(BaseModel):
    """Basic update with momentum."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    beta: float = Field(default=0.3, ge=0, lt=1)

    def next_drive(self, history, model, settings):
        gain = settings.gains[:, np.newaxis]
        if not history.playbacks:
            return NextDrive(drive=apply_inverse(model, gain * history.target, band=settings.band), model=model)
        last = history.playbacks[-1]
        before = history.playbacks[-2].drive if len(history.playbacks) > 1 else np.zeros_like(last.drive)
        step = apply_inverse(model, gain * (history.target - last.response), band=settings.band)
        drive = last.drive + step + self.beta * (last.drive - before)
        return NextDrive(drive=drive, model=model, stepped_from=last.drive)


class Raises(Momentum):
    def next_drive(self, history, model, settings):
        raise KeyError("no such table")


class Wrong(Momentum):
    """Returns what cannot be played."""

    what: str = "nan"

    def next_drive(self, history, model, settings):
        drive = super().next_drive(history, model, settings).drive
        if self.what == "number":
            return 5
        if self.what == "nan":
            drive[0, 3] = np.nan
        elif self.what == "shape":
            drive = drive[:, 1:]
        elif self.what == "noise":
            drive = np.random.default_rng(1).standard_normal(drive.shape) * 1e-3
        elif self.what == "huge":
            drive = 1e6 * drive
        return NextDrive(drive=drive, model=model)


def read_lines(path):
    rate, *rows = path.read_text().split("\\n")
    return Signals((Channel("force", "N"),), float(rate), np.array([[float(row) for row in rows if row]]))


def write_lines(signals, path):
    path.write_text("\\n".join(repr(float(value)) for value in (signals.sample_rate, *signals.samples[0])))
    return Written(path, "lines", signals.samples.shape[1], 0, (0.0,))


class Beam:
    """A rig of two springs."""

    def __init__(self, *, stiffness=4e5):
        if not stiffness > 0:
            raise ValueError(f"stiffness is {stiffness}; it must be above 0.")
        self._stiffness = stiffness

    def describe(self):
        stroke = {"unit": "m", "kind": array_pb2.CHANNEL_KIND_DISPLACEMENT, "minimum": -0.05, "maximum": 0.05}
        force = {"unit": "N", "kind": array_pb2.CHANNEL_KIND_FORCE, "minimum": -5e4, "maximum": 5e4, "watchdog": 4e4}
        return rig_pb2.RigDescription(
            rig="beam",
            specimen="two springs",
            engine="beam",
            version="1.0",
            sample_rate=200.0,
            drives=[array_pb2.Channel(name="stroke", slew_limit=1.0, holds_static=True, **stroke)],
            responses=[array_pb2.Channel(name="force", **force)],
            longest_drive_seconds=60.0,
        )

    def play(self, commands, run):
        return self._stiffness * commands

    def stop(self, reason):
        pass

    def reset(self):
        pass


LINES = FormatPlugin(suffixes=(".lines",), reader=read_lines, writer=write_lines)
NOT_A_FORMAT = 5
'''
ENTRY_POINTS = """[duralab.updates]
momentum = lab_plugins:Momentum
raises = lab_plugins:Raises
wrong = lab_plugins:Wrong
function = lab_plugins:read_lines
broken = lab_plugins:Missing
twice = lab_plugins:Momentum

[duralab.formats]
lines = lab_plugins:LINES
odd = lab_plugins:NOT_A_FORMAT

[duralab.rigs]
beam = lab_plugins:Beam
half = lab_plugins:Momentum
"""


def install(folder, name, entry_points, module=""):
    """Install a distribution as pip does: a module beside its metadata."""
    metadata = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)
    if module:
        (folder / "lab_plugins.py").write_text(module)


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plugins")
    install(folder, "lab-plugins", ENTRY_POINTS, MODULE)
    install(folder, "other-plugins", "[duralab.updates]\ntwice = lab_plugins:Momentum\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        # Of the services, which are started with this environment.
        patch.setenv("PYTHONPATH", str(folder))
        yield folder
        sys.modules.pop("lab_plugins", None)


@pytest.fixture(scope="module")
def plugin_lab(plugins, tmp_path_factory):
    with duralab.start(tmp_path_factory.mktemp("lab"), rigs=("front_axle_compliant", "predecessor")) as lab:
        yield lab


# On a busy machine each of these takes minutes.
@pytest.mark.timeout(900)
def test_a_campaign_iterates_with_the_update_of_a_plugin_and_shows_it(plugin_lab, campaign, tmp_path):
    path = campaign(update__plugin={"name": "momentum", "settings": {"beta": 0.1}}, update__iteration_gain=0.8)
    result = plugin_lab.run(path, out=tmp_path / "out")
    errors = result.iterations.relative_rms_error
    assert np.all(errors[-1] < errors[0])
    remark = "The drives are made by the update plug-in 'momentum' of lab-plugins 1.0 with beta 0.1."
    assert remark in result.status.remarks
    page = result.report().read_text(encoding="utf-8")
    assert "plug-in momentum, beta 0.1, gain 0.8" in page
    assert "update plug-in &#39;momentum&#39; of lab-plugins 1.0" in page


@pytest.mark.parametrize(
    ("plugin", "said"),
    [
        ({"name": "momentun"}, "update.plugin.name is 'momentun'; installed plug-ins of duralab.updates are "),
        ({"name": "twice"}, "'twice', which lab-plugins 1.0 and other-plugins 1.0 offer in duralab.updates; keep one"),
        ({"name": "broken"}, "'broken' of lab-plugins 1.0 cannot be imported: AttributeError"),
        ({"name": "function"}, "its entry point must name a pydantic model of its settings"),
        ({"name": "momentum", "settings": {"beta": 2}}, "update.plugin.settings.beta"),
        ({"name": "momentum", "settings": {"bta": 0.1}}, "bta"),
        ({"name": "raises"}, "'raises' of lab-plugins 1.0 raised KeyError: 'no such table'; correct it"),
        ({"name": "wrong", "settings": {"what": "number"}}, "returned int; it must return a NextDrive"),
        ({"name": "wrong", "settings": {"what": "nan"}}, "drive of the NextDrive that the update plug-in 'wrong'"),
        ({"name": "wrong", "settings": {"what": "shape"}}, "has the shape (6, "),
        ({"name": "wrong", "settings": {"what": "noise"}}, "of its RMS above 4"),
        ({"name": "wrong", "settings": {"what": "huge"}}, "limit"),
    ],
)
def test_what_is_wrong_with_a_plugin_is_one_sentence(plugin_lab, campaign, tmp_path, plugin, said):
    with pytest.raises(duralab.LabError) as caught:
        plugin_lab.run(campaign(update__plugin=plugin), out=tmp_path / "out")
    sentence = str(caught.value)
    assert said in sentence
    assert "\n" not in sentence
    assert "Traceback" not in sentence


def test_files_of_a_format_plugin_are_read_and_written(plugins, tmp_path):
    signals = duralab.Signals((duralab.Channel("force", "N"),), 100.0, np.array([[0.5, -1.25, 3.0]]))
    assert write_signals(signals, tmp_path / "a.lines").samples == 3
    found = read_signals(tmp_path / "a.lines")
    np.testing.assert_array_equal(found.samples, signals.samples)
    assert found.sample_rate == 100.0


def test_what_is_wrong_with_a_format_plugin_is_one_sentence(plugins, tmp_path):
    (tmp_path / "a.lines").write_text("100\nfive\n")
    for arguments, said in {
        ("a.lines", None): "the format plug-in 'lines' of lab-plugins 1.0 raised ValueError: could not convert",
        ("a.lines", "linse"): "format is 'linse'; rpc3, mdf4, uff58, tdms, mat, csv, parquet, lines, odd are known.",
        ("a.lines", "odd"): "The format plug-in 'odd' of lab-plugins 1.0 is int; its entry point must name",
    }.items():
        with pytest.raises(duralab.InputError) as caught:
            read_signals(tmp_path / arguments[0], format=arguments[1])
        assert said in str(caught.value)


def wait_until_it_listens(port, process):
    while process.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    pytest.fail(f"the gateway ended with {process.returncode}")


def test_the_rig_of_a_plugin_is_served(plugins, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    endpoint = f"tcp/127.0.0.1:{port}"
    config = tmp_path / "gateway.yaml"
    config.write_text(yaml.safe_dump({"bus": {"listen": [endpoint]}, "rigs": {"beam": {"stiffness": 1e5}}}))
    process = subprocess.Popen([sys.executable, "-m", "duralab_gateway", "--config", str(config)])
    try:
        wait_until_it_listens(port, process)
        with open_bus(BusConfig(connect=(endpoint,)), service="duralab") as bus:
            # Declared live when all of the contract is served.
            bus.wait_for_live({("rig_sim", "beam")}, 60.0)
    finally:
        process.terminate()
        process.wait()


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("beem", {}, "rigs.beem is 'beem'; installed plug-ins of duralab.rigs are beam, half: correct the name"),
        ("half", {}, "names is without describe, play, stop, reset; its entry point must name a class"),
        ("beam", {"stiffness": -1.0}, "raised ValueError: stiffness is -1.0; it must be above 0 with the settings"),
        ("beam", {"mass": 1.0}, "raised TypeError: "),
    ],
)
def test_what_is_wrong_with_a_rig_plugin_is_one_sentence(plugins, name, settings, said):
    with pytest.raises(ConfigError) as caught:
        rig_plugin(name, settings)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
