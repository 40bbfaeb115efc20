"""Every format keeps what it can of signals, says what it cannot, and refuses what it does not hold."""

import dataclasses
import sys

import numpy as np
import pytest

from duralab import Channel, InputError, Signals
from duralab.formats import Format, FormatError, read_signals, write_signals

SUFFIX = {
    Format.RPC3: ".rsp", Format.MDF4: ".mf4", Format.UFF58: ".uff", Format.TDMS: ".tdms", Format.MAT: ".mat",
    Format.CSV: ".csv", Format.PARQUET: ".parquet",
}  # fmt: skip
EXACT = [form for form in Format if form is not Format.RPC3]
LIBRARY = {Format.MDF4: "asammdf", Format.UFF58: "pyuff", Format.TDMS: "nptdms", Format.PARQUET: "pyarrow"}


def some_signals(rate=1024.0, samples=1500, **changes):
    rng = np.random.default_rng(1)
    channels = (Channel("left_vertical", "N"), Channel("left lateral", "m/s^2"), Channel("strain", "1"))
    return dataclasses.replace(
        Signals(channels, rate, rng.normal(size=(3, samples)) * [[1e4], [1e-9], [1.0]]), **changes
    )


@pytest.mark.parametrize("rate", [250.0, 1000.0, 8192.0, 51200.0])
@pytest.mark.parametrize("form", EXACT)
def test_names_units_rate_and_every_bit_of_the_samples_come_back(tmp_path, form, rate):
    signals = some_signals(rate)
    path = tmp_path / f"a{SUFFIX[form]}"
    written = write_signals(signals, path)
    back = read_signals(path)
    assert back.names == signals.names
    assert [channel.unit for channel in back.channels] == [channel.unit for channel in signals.channels]
    assert back.sample_rate == rate
    np.testing.assert_array_equal(back.samples, signals.samples)
    assert back.samples.dtype == np.float64
    assert back.samples.flags.c_contiguous
    assert (written.path, written.format, written.samples, written.padding) == (path, form.value, 1500, 0)
    assert written.largest_errors == (0.0, 0.0, 0.0)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [path.name]


@pytest.mark.parametrize("form", Format)
def test_attributes_are_kept_or_their_loss_is_told(tmp_path, form):
    signals = some_signals(attributes={"OPERATION": "drove over it", "SITE": "proving ground"})
    path = tmp_path / f"a{SUFFIX[form]}"
    written = write_signals(signals, path)
    back = read_signals(path).attributes
    assert signals.attributes.items() <= back.items() or any("keeps" in note for note in written.notes)


@pytest.mark.parametrize("form", Format)
def test_a_file_that_is_there_is_replaced_only_when_asked(tmp_path, form):
    path = tmp_path / f"a{SUFFIX[form]}"
    path.write_bytes(b"mine")
    with pytest.raises(InputError, match="overwritten"):
        write_signals(some_signals(), path)
    assert path.read_bytes() == b"mine"
    write_signals(some_signals(), path, overwrite=True)
    assert read_signals(path).names == some_signals().names


def test_the_format_can_be_named_where_the_suffix_says_nothing(tmp_path):
    path = tmp_path / "data.bin"
    with pytest.raises(InputError, match=r"suffix '.bin'"):
        write_signals(some_signals(), path)
    with pytest.raises(InputError, match="'wav'; rpc3"):
        read_signals(path, format="wav")
    for form in Format:
        write_signals(some_signals(), path, format=form, overwrite=True)
        assert read_signals(path, format=form).names == some_signals().names


@pytest.mark.parametrize(("form", "library"), LIBRARY.items())
def test_a_library_that_is_not_installed_is_named_with_the_extra_that_brings_it(tmp_path, monkeypatch, form, library):
    path = tmp_path / f"a{SUFFIX[form]}"
    write_signals(some_signals(), path)
    monkeypatch.setitem(sys.modules, library, None)
    actions = [lambda: read_signals(path), lambda: write_signals(some_signals(), path, overwrite=True)]
    # Universal files are written by a writer of our own.
    for action in actions[: 1 if form is Format.UFF58 else 2]:
        with pytest.raises(InputError, match=rf"needs {library}, .*pip install 'duralab\["):
            action()


@pytest.mark.parametrize("form", Format)
def test_what_is_empty_something_else_or_not_there_is_one_sentence_with_the_file(tmp_path, form):
    path = tmp_path / f"a{SUFFIX[form]}"
    for content in (None, b"", b"\0" * 5000, b"PK\3\4 something else " * 300, b"\xff" * 3000):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(FormatError) as caught:
            read_signals(path)
        assert str(path) in caught.value.message
        assert "\n" not in caught.value.message
    with pytest.raises(FormatError):
        read_signals(tmp_path, format=form)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"samples": np.array([[1.0, np.nan]] * 3)}, "sample 1 of left_vertical is nan"),
        ({"samples": np.ones((2, 5))}, r"shape \(2, 5\)"),
        ({"samples": np.ones((3, 0))}, r"shape \(3, 0\)"),
        ({"sample_rate": 0.0}, "sample_rate is 0.0"),
    ],
)
def test_signals_that_no_format_holds_are_refused_and_nothing_is_left(tmp_path, changes, said):
    for form in Format:
        with pytest.raises(InputError, match=said):
            write_signals(dataclasses.replace(some_signals(), **changes), tmp_path / "a", format=form)
    assert list(tmp_path.iterdir()) == []


def test_only_rpc3_has_a_choice_of_numbers(tmp_path):
    coarse = write_signals(some_signals(), tmp_path / "a.rsp")
    fine = write_signals(some_signals(), tmp_path / "b.rsp", data_type="floating_point")
    assert max(fine.largest_errors) < max(coarse.largest_errors) / 100
    with pytest.raises(InputError, match="only rpc3"):
        write_signals(some_signals(), tmp_path / "a.csv", data_type="FLOATING_POINT")
    with pytest.raises(InputError, match="data_type is 'double'; SHORT_INTEGER"):
        write_signals(some_signals(), tmp_path / "c.rsp", data_type="double")
