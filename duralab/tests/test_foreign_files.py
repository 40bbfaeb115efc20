"""Files as other programs write them: read where their meaning is clear, refused with the reason where it is not."""

import re
from csv import reader as csv_reader
from decimal import Decimal

import asammdf
import nptdms
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from test_cli import invoke

from duralab import Channel, InputError, Signals
from duralab.formats import LEFT_OUT, FormatError, read_signals, write_signals
from duralab_drive_files import unique_names

TIME = np.arange(100) / 200


def csv(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("start", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_csv_text_of_any_separator_and_line_end_is_read(tmp_path, separator, start, end):
    lines = [["time [s]", "left vertical [N]", '"f, b [1] [mm]"'], ["0", "1.5", "-2e3"], [" 0.01", "2", "3"]]
    signals = read_signals(csv(tmp_path, start + end.join(separator.join(line) for line in lines) + end))
    assert signals.names == ("left vertical", "f, b [1]")
    assert [channel.unit for channel in signals.channels] == ["N", "mm"]
    assert signals.sample_rate == 100.0
    np.testing.assert_array_equal(signals.samples, [[1.5, 2.0], [-2000.0, 3.0]])


@pytest.mark.parametrize(
    ("text", "said", "offset"),
    [
        ("time [s],a [N]\n0,1\n0.1,x\n0.2,3\n", "line 3", 19),
        ("time [s],a [N]\n0,1\n0.1\n", "(this line has 1, the lines before have 2)", 19),
        ("time [s],a [N]\n0,1\n0.1,2,3\n", "(this line has 3, the lines before have 2)", 19),
        ("time [s],a [N]\n0,1,2\n0.1,2,3\n", "line 2: 2 numbers", 0),
        ("time [s];a [N]\n0;1,5\n1;2\n", "line 2", 15),
        ("time [s],a [N]\n", "no samples", None),
        ("time [s],a [N]\n0,1\n", "2 or more", None),
        ("time,a [N]\n0,1\n1,2\n", "'time'; 'time [s]' was expected", 0),
        ("time [s],a\n0,1\n1,2\n", "'a' names no unit", 0),
        ("time [s]\n0\n1\n", "no column beside the time", 0),
        ("time [s],a [N]\n0,1\n1,nan\n", "sample 1 of a is nan", None),
        ("time [s],a [N]\n0,1\n1,2\n1.5,2\n", "time steps differ", None),
        ("time [s],a [N]\n2,1\n1,2\n0,2\n", "time steps differ", None),
    ],
)
def test_csv_text_that_is_wrong_is_named_with_line_and_byte(tmp_path, text, said, offset):
    with pytest.raises(FormatError) as caught:
        read_signals(csv(tmp_path, text))
    assert said in caught.value.message
    assert caught.value.offset == offset


def test_text_in_another_encoding_is_named_with_the_byte(tmp_path):
    with pytest.raises(FormatError, match="no UTF-8 text") as caught:
        read_signals(csv(tmp_path, "time [s],a [N]\n0,1\n1,ä\n", "latin-1"))
    assert caught.value.offset == 21


def mdf(tmp_path, *groups):
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as measurement:
        for group in groups:
            measurement.append(
                [asammdf.Signal(samples, time, name=name, unit="N", encoding="utf-8") for name, time, samples in group]
            )
        measurement.save(path, overwrite=True)
    return path


def test_mdf_groups_of_one_time_are_read_together_and_integers_become_numbers(tmp_path):
    first, second = np.arange(100), np.linspace(-1, 1, 100)
    signals = read_signals(mdf(tmp_path, [("a", TIME, first)], [("b", TIME, second)]))
    assert signals.names == ("a", "b")
    assert signals.sample_rate == 200.0
    np.testing.assert_array_equal(signals.samples, [first, second])


def test_mdf_groups_of_different_times_are_refused(tmp_path):
    path = mdf(tmp_path, [("a", TIME, np.ones(100))], [("b", TIME[:50] * 2, np.ones(50))])
    with pytest.raises(FormatError, match="a has 100 and b 50 samples"):
        read_signals(path)


def tdms(tmp_path, *channels):
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("g", name, data, properties=properties) for name, data, properties in channels]
        )
    return path


def test_tdms_channels_of_one_step_are_read_and_texts_left_out(tmp_path):
    step = {"wf_increment": 0.005, "unit_string": "kN"}
    signals = read_signals(tdms(tmp_path, ("a", np.arange(5, dtype=np.int16), step), ("b", np.ones(5), step)))
    assert (signals.names, signals.sample_rate, signals.channels[0].unit) == (("a", "b"), 200.0, "kN")
    for other in ({"wf_increment": 0.01}, {}):
        with pytest.raises(FormatError, match="one wf_increment"):
            read_signals(tdms(tmp_path, ("a", np.ones(5), step), ("b", np.ones(5), other)))


def test_a_parquet_table_of_other_columns_or_with_nulls_is_refused(tmp_path):
    path = tmp_path / "a.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"time [s]": TIME, "a [N]": TIME.astype(np.float32)}), path)
    assert read_signals(path).names == ("a",)
    for table, said in (
        ({"t": TIME, "a [N]": TIME}, "first column is 't'"),
        ({"time [s]": [0.0, 1.0], "a [N]": [1.0, None]}, "has nulls"),
        ({"time [s]": [0.0, 1.0], "a [N]": ["x", "y"]}, "is of type string"),
    ):
        pyarrow.parquet.write_table(pyarrow.table(table), path)
        with pytest.raises(FormatError, match=said):
            read_signals(path)


def test_a_matlab_file_with_other_variables_is_refused_with_what_it_has(tmp_path):
    path = tmp_path / "a.mat"
    good = {"samples": np.ones((2, 9)), "sample_rate": 100, "names": np.array(["a", "b"], dtype=object),
            "units": np.array(["N", ""], dtype=object)}  # fmt: skip
    for changes, said in (
        ({"samples": None}, "lacks samples"),
        ({"samples": np.ones((9, 2))}, "2 names"),
        ({"samples": np.array([["x"]])}, "samples is"),
        ({"sample_rate": 0}, "sample_rate is"),
        ({"samples": np.full((2, 9), np.inf)}, "sample 0 of a is inf"),
    ):
        content = {name: value for name, value in (good | changes).items() if value is not None}
        scipy.io.savemat(path, content)
        with pytest.raises(FormatError, match=said):
            read_signals(path)
    scipy.io.savemat(path, good)
    assert [channel.unit for channel in read_signals(path).channels] == ["N", ""]


FORMULA = "=+-@\t＝＋－＠"
NAMES = st.text(st.sampled_from("=+-@'\";,\t |a[]＝＠"), min_size=1, max_size=8)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(NAMES, min_size=1, max_size=3))
@example(["=cmd|' /C calc'!A0", "'=cmd", 'a;"=cmd'])
def test_no_cell_of_a_csv_header_is_a_formula_and_each_name_comes_back(tmp_path, names):
    path = tmp_path / "a.csv"
    signals = Signals(tuple(Channel(name, "N") for name in names), 10.0, np.arange(3.0) * np.ones((len(names), 1)))
    write_signals(signals, path, overwrite=True)
    header = path.read_text(encoding="utf-8").split("\n")[0]
    for separator in ",;\t":
        for cell in next(csv_reader([header], delimiter=separator)):
            assert not cell.lstrip("\"'").startswith(tuple(FORMULA)) or cell.startswith("'")
    # As of every format: what surrounds a name is left out, and names are told apart.
    assert read_signals(path).names == tuple(unique_names(names))


def test_csv_refuses_a_name_that_would_end_its_header(tmp_path):
    signals = Signals((Channel("a\nb", "N"),), 10.0, np.ones((1, 3)))
    with pytest.raises(InputError, match=r"The channel 'a\\nb' in 'N' has a line break"):
        write_signals(signals, tmp_path / "a.csv")
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"wf_start_offset": 5.0}, "'a' starts at 0.0 s and 'b' at 5.0 s; one start"),
        ({"wf_start_time": np.datetime64("2020-01-01T00:00:01", "us")}, "and 'b' at 0.0 s after 2020"),
        ({"wf_xunit_string": "ms"}, "the axis of 'b' is 'ms'; time in seconds was expected"),
        ({"wf_xunit_string": "Hz"}, "the axis of 'b' is 'Hz'"),
    ],
)
def test_tdms_channels_without_one_time_in_seconds_are_refused(tmp_path, changes, said):
    step = {"wf_increment": 0.005, "wf_start_offset": 0, "wf_xunit_string": "s"}
    path = tdms(tmp_path, ("a", np.ones(5), step), ("b", np.ones(5), step))
    assert read_signals(path).names == ("a", "b")
    with pytest.raises(FormatError, match=said):
        read_signals(tdms(tmp_path, ("a", np.ones(5), step), ("b", np.ones(5), step | changes)))


def test_channels_that_are_left_out_are_named(tmp_path):
    step = {"wf_increment": 0.005}
    others = (np.ones(5) * 1j, np.ones(5, dtype=bool), np.array(["x"] * 5))
    path = tdms(tmp_path, ("a", np.ones(5), step), *((f"b{place}", data, step) for place, data in enumerate(others)))
    signals = read_signals(path)
    assert signals.names == ("a",)
    assert signals.attributes == {LEFT_OUT: "Channels that are not real numbers are left out: b0, b1, b2."}
    texts = mdf(tmp_path, [("a", TIME[:2], np.ones(2)), ("gear", TIME[:2], np.array([b"P", b"D"]))])
    assert read_signals(texts).attributes == {LEFT_OUT: "Channels that are not real numbers are left out: gear."}
    for command in (["info", texts], ["convert", path, tmp_path / "a.csv"]):
        assert "Channels that are not real numbers are left out" in invoke(*command)[1]
    # The copy holds all of its channels.
    write_signals(signals, tmp_path / "copy.tdms")
    assert read_signals(tmp_path / "copy.tdms").attributes == {}


def test_mdf_samples_that_are_marked_invalid_are_refused(tmp_path):
    path = tmp_path / "a.mf4"
    invalid = np.arange(100) >= 50
    for bits in (np.zeros(100, dtype=bool), invalid):
        with asammdf.MDF(version="4.10") as measurement:
            measurement.append([asammdf.Signal(np.ones(100), TIME, name="a", unit="N", invalidation_bits=bits)])
            measurement.save(path, overwrite=True)
        if bits is not invalid:
            assert read_signals(path).samples.shape == (1, 100)
    with pytest.raises(FormatError, match="50 samples of a are marked as invalid, the first is sample 50"):
        read_signals(path)


@pytest.mark.parametrize(
    ("column", "kind", "data"),
    [
        ("time [s]", r"timestamp\[us\]", np.arange(100).astype("datetime64[us]")),
        ("time [s]", r"duration\[ms\]", np.arange(100).astype("timedelta64[ms]")),
        ("a [N]", r"duration\[us\]", np.arange(100).astype("timedelta64[us]")),
        ("a [N]", "bool", TIME > 0),
        ("a [N]", "string", ["1"] * 100),
    ],
)
def test_a_parquet_column_that_is_not_of_numbers_is_refused(tmp_path, column, kind, data):
    path = tmp_path / "a.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"time [s]": TIME, "a [N]": TIME, column: data}), path)
    with pytest.raises(FormatError, match=rf"the column '{re.escape(column)}' is of type {kind}; integers or floating"):
        read_signals(path)


def logged(tmp_path, rate, decimals, *, samples=2000, start=0.0, change=None):
    """Return a CSV file of a logger that rounds its time stamps."""
    times = [f"{start + place / rate:.{decimals}f}" for place in range(samples)]
    if change is not None:
        change(times)
    return csv(tmp_path, "time [s],a [N]\n" + "".join(f"{time},1\n" for time in times))


@pytest.mark.parametrize("start", [0.0, 7.0, 1234.56789])
@pytest.mark.parametrize(
    ("rate", "decimals"),
    [(2048.0, 6), (2048.0, 5), (512.0, 5), (512.0, 6), (409.6, 6), (204.8, 5), (102.4, 4), (100.0, 3)],
)
def test_rounded_time_stamps_are_those_of_their_rate(tmp_path, rate, decimals, start):
    if start == 1234.56789 and decimals < 5:
        start = 1234.5
    assert read_signals(logged(tmp_path, rate, decimals, start=start)).sample_rate == rate


@pytest.mark.parametrize("place", [1, 2, 1000, 1997, 1998])
@pytest.mark.parametrize(("rate", "decimals"), [(2048.0, 6), (2048.0, 5), (512.0, 5), (100.0, 3), (409.6, 4)])
def test_rounded_time_stamps_with_a_missing_sample_are_refused(tmp_path, rate, decimals, place):
    with pytest.raises(FormatError, match="the time steps differ"):
        read_signals(logged(tmp_path, rate, decimals, change=lambda times: times.pop(place)))


@pytest.mark.parametrize(("rate", "decimals"), [(2048.0, 6), (2048.0, 5), (512.0, 5), (100.0, 3), (409.6, 4)])
def test_time_stamps_that_differ_by_more_than_their_rounding_are_refused(tmp_path, rate, decimals):
    def late(times):
        times[700] = f"{float(times[700]) + 1.5 * 10.0**-decimals:.{decimals}f}"

    with pytest.raises(FormatError, match="the time steps differ"):
        read_signals(logged(tmp_path, rate, decimals, change=late))


@pytest.mark.parametrize("step", ["0.0003", "0.011", "0.003", "0.00007"])
def test_a_time_step_of_few_digits_is_exact(tmp_path, step):
    for samples in (3, 100, 5000):
        times = [str(place * Decimal(step)) for place in range(samples)]
        signals = read_signals(csv(tmp_path, "time [s],a [N]\n" + "".join(f"{time},1\n" for time in times)))
        assert signals.sample_rate == pytest.approx(1 / float(step), rel=1e-12)
