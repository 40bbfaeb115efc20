"""Error sentences of file formats that no command can provoke: plug-ins, and calls of the SDK."""

import dataclasses
import sys

import numpy as np
import pytest

from duralab import Channel, InputError, Signals
from duralab.formats import (
    FormatError,
    FrequencyResponse,
    read_frequency_response,
    read_signals,
    write_frequency_response,
    write_signals,
)
from duralab.formats.libraries import parsing
from duralab.formats.matlab import write_mat

SIGNALS = Signals((Channel("a", "N"),), 10.0, np.arange(5.0)[np.newaxis])
MODULE = """
import numpy as np

from duralab import Channel, Signals
from duralab.formats import FormatPlugin, Written

SIGNALS = Signals((Channel("a", "N"),), 10.0, np.zeros((2, 5)))


def fail(*arguments):
    raise KeyError("no table")


read_only = FormatPlugin((".both",), reader=fail)
fails = FormatPlugin((".both", ".fails"), reader=fail, writer=fail)
returns_text = FormatPlugin((), reader=lambda path: "text", writer=lambda signals, path: "text")
too_many_rows = FormatPlugin((), reader=lambda path: SIGNALS)
number = 5
"""
NAMES = ("read_only", "fails", "returns_text", "too_many_rows", "number", "missing")


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    metadata = tmp_path / "plugins" / "faulty_formats-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty-formats\nVersion: 1.0\n")
    entries = "\n".join(f"{name} = faulty_formats:{name}" for name in NAMES)
    (metadata / "entry_points.txt").write_text(f"[duralab.formats]\n{entries}\n")
    (metadata.parent / "faulty_formats.py").write_text(MODULE)
    monkeypatch.syspath_prepend(metadata.parent)
    monkeypatch.delitem(sys.modules, "faulty_formats", raising=False)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("missing", "The plug-in 'missing' of faulty-formats 1.0 cannot be imported"),
        ("number", "'number' of faulty-formats 1.0 is int; its entry point must name a duralab.formats.FormatPlugin"),
        ("fails", "raised KeyError: .*no table.*; correct the file or the plug-in"),
        ("returns_text", "returned str; it must return Signals"),
        ("too_many_rows", r"returned samples of shape \(2, 5\) for 1 channels; it must return finite samples"),
    ],
)
def test_a_plugin_that_cannot_read_is_named(plugins, tmp_path, name, said):
    path = tmp_path / "a.bin"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=said):
        read_signals(path, format=name)


@pytest.mark.parametrize(
    ("file", "name", "said"),
    [
        ("a.bin", "read_only", "The format plug-in 'read_only' of faulty-formats 1.0 only reads; write another format"),
        ("a.fails", None, "raised KeyError: .*no table.*; correct the plug-in"),
        ("a.bin", "returns_text", "wrote no file or returned str; it must write it and return Written"),
        ("a.both", None, "suffix '.both' are of the formats fails and read_only; name one: format=fails"),
    ],
)
def test_a_plugin_that_cannot_write_is_named_and_leaves_nothing(plugins, tmp_path, file, name, said):
    with pytest.raises(InputError, match=said):
        write_signals(SIGNALS, tmp_path / file, format=name)
    assert [path.name for path in tmp_path.iterdir()] == ["plugins"]


def test_signals_too_large_for_a_matlab_file_are_refused(tmp_path):
    large = dataclasses.replace(SIGNALS, samples=np.broadcast_to(0.0, (1, 1 << 28)))
    with pytest.raises(InputError, match="The samples take 2147483648 bytes; a MATLAB file of level 5 holds"):
        write_mat(large, tmp_path / "a.mat")


def test_a_file_that_cannot_be_opened_is_named(tmp_path):
    with (
        pytest.raises(FormatError, match=r"a\.mat: it cannot be read .*; correct its rights"),
        parsing(tmp_path / "a.mat", "a MATLAB file"),
    ):
        pass


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("force per left", "strain per right"), "2 frequency responses at 1 sets of frequencies; one for each of 2"),
        (("force per left", "force of right"), "a frequency response is called 'force of right'; '<response> per"),
    ],
)
def test_frequency_responses_that_are_no_matrix_are_refused(tmp_path, names, said):
    path = tmp_path / "h.uff"
    response = FrequencyResponse((Channel("left", "m"),), (Channel("force", "N"),), np.arange(3.0), np.ones((3, 1, 1)))
    write_frequency_response(response, path)
    content = path.read_bytes()
    written = [content.replace(b"force per left".ljust(80), name.encode().ljust(80)) for name in names]
    path.write_bytes(b"".join(written))
    with pytest.raises(FormatError, match=said):
        read_frequency_response(path)


def test_one_line_is_no_frequency_response_for_uff58(tmp_path):
    response = FrequencyResponse((Channel("left", "m"),), (Channel("force", "N"),), np.ones(1), np.ones((1, 1, 1)))
    with pytest.raises(InputError, match=r"0 of 1 lines .* 2 lines or more are needed"):
        write_frequency_response(response, tmp_path / "h.uff")
