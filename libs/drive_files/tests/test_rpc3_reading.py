"""RPC III files made from the description, and a real one, are read; what is damaged is refused with its place."""

import struct
from pathlib import Path

import numpy as np
import pytest
import rpc3_files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from duralab_drive_files import DriveFileError, read_rpc3, unique_names
from duralab_drive_files.rpc3_reading import PADDING_ATTRIBUTE

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "pyRPC3_test1.rsp"
CHANNELS = [("left_vertical", "N", "0.5"), ("left_lateral", "m/s^2", "2.5E-01")]


def stored(count, points, *, seed=0):
    return np.random.default_rng(seed).integers(-32752, 32752, size=(count, points)).tolist()


def write(tmp_path, content):
    path = tmp_path / "a.rsp"
    path.write_bytes(content)
    return path


def plain(tmp_path, values=None, numbers=None, *, code="<h", points_per_group=2048, **how):
    values = values or rpc3_files.keywords(CHANNELS)
    numbers = numbers or stored(2, 2048)
    content = rpc3_files.header(values, **how)
    return write(tmp_path, content + rpc3_files.data(numbers, points_per_group=points_per_group, code=code))


def test_integers_are_worth_their_channels_scale(tmp_path):
    numbers = stored(2, 2048)
    signals = read_rpc3(plain(tmp_path, numbers=numbers))
    np.testing.assert_array_equal(signals.samples, np.array(numbers) * [[0.5], [0.25]])
    assert signals.sample_rate == 250.0
    assert signals.names == ("left_vertical", "left_lateral")
    assert list(signals.units) == ["N", "m/s^2"]
    assert signals.samples.dtype == np.float64
    assert signals.samples.flags.c_contiguous


@pytest.mark.parametrize("points_per_group", [2048, 4096, 16384])
@pytest.mark.parametrize("frames", [1, 7, 40, 161])
def test_groups_follow_each_other_and_the_padding_is_kept_where_the_length_is_not_told(
    tmp_path, frames, points_per_group
):
    values = rpc3_files.keywords(CHANNELS, FRAMES=frames, PTS_PER_GROUP=points_per_group)
    numbers = stored(2, frames * 256)
    signals = read_rpc3(plain(tmp_path, values, numbers, points_per_group=points_per_group))
    np.testing.assert_array_equal(signals.samples, np.array(numbers) * [[0.5], [0.25]])
    assert "may be padding" in signals.attributes[PADDING_ATTRIBUTE]


def test_padding_is_cut_off_where_the_file_tells_its_length_and_that_is_said(tmp_path):
    signals = read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, SAMPLES=2000)))
    assert signals.samples.shape == (2, 2000)
    assert signals.attributes[PADDING_ATTRIBUTE].startswith("48 samples of padding")


@pytest.mark.parametrize("samples", [1, 2047, 2048, 2049, 4096, 4097])
def test_a_length_may_end_anywhere_in_a_group_or_leave_whole_groups_out(tmp_path, samples):
    numbers = stored(2, 24 * 256)
    signals = read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, FRAMES=24, SAMPLES=samples), numbers))
    np.testing.assert_array_equal(signals.samples, (np.array(numbers) * [[0.5], [0.25]])[:, :samples])


def test_half_frames_lie_at_both_ends(tmp_path):
    numbers = stored(2, 9 * 256)
    signals = read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, HALF_FRAMES=1), numbers))
    np.testing.assert_array_equal(signals.samples, np.array(numbers) * [[0.5], [0.25]])


@pytest.mark.parametrize(("form", "order"), [("BINARY", "<"), ("BINARY_IEEE_BIG_END", ">")])
@pytest.mark.parametrize(("data_type", "code"), [("SHORT_INTEGER", "h"), ("FLOATING_POINT", "f")])
def test_both_byte_orders_and_both_kinds_of_number(tmp_path, form, order, data_type, code):
    values = rpc3_files.keywords(CHANNELS, FORMAT=form, DATA_TYPE=data_type)
    numbers = stored(2, 2048)
    signals = read_rpc3(plain(tmp_path, values, numbers, code=order + code))
    # A floating-point number stands for itself; its SCALE is left over from the integers.
    scale = [[0.5], [0.25]] if code == "h" else 1.0
    np.testing.assert_array_equal(signals.samples, np.array(numbers) * scale)


@pytest.mark.parametrize("time_type", ["DRIVE", "MULT_DRIVE", "MULT_RESP", "CONFIG_DRIVE", "CONFIG_RESP", "4", "drive"])
def test_every_kind_of_time_history_is_read(tmp_path, time_type):
    signals = read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, TIME_TYPE=time_type)))
    assert signals.attributes["TIME_TYPE"] == time_type


def test_old_files_number_kinds_from_one(tmp_path):
    numbers = stored(2, 2048)
    for number, code, scale in (("1", "<h", [[0.5], [0.25]]), ("2", "<f", 1.0)):
        path = plain(tmp_path, rpc3_files.keywords(CHANNELS, DATA_TYPE=number), numbers, code=code)
        np.testing.assert_array_equal(read_rpc3(path).samples, np.array(numbers) * scale)
    with pytest.raises(DriveFileError, match="picked peaks"):
        read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, TIME_TYPE="7")))


def test_a_scale_may_be_as_large_as_its_full_scale_is_finite(tmp_path):
    values = rpc3_files.keywords([("a", "N", "5e303"), ("b", "N", "1")])
    samples = read_rpc3(plain(tmp_path, values, [[-32768] * 2048, [1] * 2048])).samples
    np.testing.assert_array_equal(samples[0], -32768 * 5e303)


def test_what_real_writers_do_is_read(tmp_path):
    channels = [("  Left  ", "µm/m ", "0.5"), ("Left", "°", "0.25"), ("", "", "1")]
    values = rpc3_files.keywords(
        channels, FILE_TYPE="Time_History", NCODE_STAT1_CHAN_1="1,2,3", DELTA_T=" 4.0D-03 ", FRAMES="8.0"
    )
    content = rpc3_files.header(values, extra_blocks=3, upper=str.lower).replace(b"format", b"FORMAT")
    content += rpc3_files.data(stored(3, 2048), points_per_group=2048, code="<h") + bytes(512)
    signals = read_rpc3(write(tmp_path, content))
    assert signals.names == ("Left", "Left_2", "channel_3")
    assert list(signals.units) == ["µm/m", "°", ""]
    assert signals.sample_rate == 250.0
    assert signals.attributes["NCODE_STAT1_CHAN_1"] == "1,2,3"
    assert "512 bytes" in signals.attributes["duralab.trailing_bytes"]


@pytest.mark.parametrize(
    ("names", "unique"),
    [
        (["Fz", "Fz", "Fz_2"], ["Fz", "Fz_3", "Fz_2"]),
        (["Fz", "Fz", " Fz_2 ", "Fz_2"], ["Fz", "Fz_3", "Fz_2", "Fz_2_2"]),
        (["", "channel_1"], ["channel_1_2", "channel_1"]),
        (["", "", "channel_2_2"], ["channel_1", "channel_2", "channel_2_2"]),
    ],
)
def test_a_name_that_the_file_gives_stays_with_its_channel(names, unique):
    assert unique_names(names) == unique


def test_records_may_be_empty_and_of_a_keyword_that_comes_twice_the_first_counts(tmp_path):
    path = plain(tmp_path)
    content = path.read_bytes()
    for before, after in ((("HALF_FRAMES", 0), ("", "")), (("REPEATS", 1), ("DELTA_T", 1))):
        assert rpc3_files.record(*before) in content
        content = content.replace(rpc3_files.record(*before), rpc3_files.record(*after))
    signals = read_rpc3(write(tmp_path, content))
    assert signals.sample_rate == 250.0
    np.testing.assert_array_equal(signals.samples, read_rpc3(plain(tmp_path)).samples)


def test_what_follows_the_first_nul_of_a_record_is_not_read(tmp_path):
    path = plain(tmp_path)
    content = bytearray(path.read_bytes())
    place = content.index(b"left_vertical") + len("left_vertical")
    content[place + 1 : place + 5] = b"junk"
    path.write_bytes(content)
    assert read_rpc3(path).names[0] == "left_vertical"


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("1.220703E-04", 8192.0),
        ("9.765625E-04", 1024.0),
        ("2.5", 0.4),
        *((text, 409.6) for text in ("2.441406E-03", "2.44141E-03", "0.0024414")),
        ("4.882813E-03", 204.8),
        ("0.0097656", 102.4),
        *((text, 512.0) for text in ("0.00195312", "0.0019531")),
        ("0.00097656", 1024.0),
        ("4.8828E-04", 2048.0),
        *((text, 1 / float(text)) for text in ("0.003", "0.011", "0.0003", "0.00030000", "3.00000E-04", "0.0003000")),
        *((text, 1 / float(text)) for text in ("0.00016384", "0.00032768", "0.00065536", "0.00128")),
    ],
)
def test_the_sample_rate_is_what_the_digits_mean(tmp_path, text, rate):
    assert read_rpc3(plain(tmp_path, rpc3_files.keywords(CHANNELS, DELTA_T=text))).sample_rate == rate


@pytest.mark.skipif(not REAL.exists(), reason=f"the real file {REAL.name} is not beside the repository")
def test_a_file_of_a_commercial_tool_agrees_with_the_statistics_that_it_wrote_into_the_header():
    signals = read_rpc3(REAL)
    assert signals.samples.shape == (5, 2048)
    assert signals.sample_rate == 250.0
    assert list(signals.units) == ["N", "m/s^2", "N", "N", "mm"]
    for row, samples in enumerate(signals.samples, start=1):
        highest, lowest, mean, deviation, rms = map(float, signals.attributes[f"NCODE_STAT1_CHAN_{row}"].split(","))
        # Its integers end at 32767, one short of its own full scale of 32768.
        scale = 1.01 * float(signals.attributes[f"SCALE.CHAN_{row}"])
        assert samples.max() == pytest.approx(highest, abs=scale)
        assert samples.min() == pytest.approx(lowest, abs=scale)
        assert samples.mean() == pytest.approx(mean, abs=scale)
        assert samples.std() == pytest.approx(deviation, rel=1e-3)
        assert np.sqrt(np.mean(samples**2)) == pytest.approx(rms, rel=1e-4)


@pytest.mark.parametrize(
    ("keyword", "value", "said"),
    [
        ("FORMAT", "ASCII", "BINARY"),
        ("FORMAT", "BINÄRY", "BINARY"),
        ("FILE_TYPE", "SPECTRAL", "TIME_HISTORY"),
        ("TIME_TYPE", "PEAK_PICK", "evenly spaced"),
        ("TIME_TYPE", "9", "MULT_RESP"),
        ("DATA_TYPE", "LONG", "FLOATING_POINT"),
        ("DELTA_T", "0", "greater than 0"),
        ("DELTA_T", "-1", "greater than 0"),
        ("DELTA_T", "1e-999999999", "greater than 0"),
        ("DELTA_T", "1e999999", "greater than 0"),
        ("DELTA_T", "NaN", "greater than 0"),
        ("DELTA_T", "fast", "greater than 0"),
        ("CHANNELS", "0", "from 1 to 1024"),
        ("CHANNELS", "1e99999999", "from 1 to 1024"),
        ("CHANNELS", "two", "from 1 to 1024"),
        ("PTS_PER_FRAME", "-256", "from 1 to 16777216"),
        ("PTS_PER_FRAME", "16777217", "from 1 to 16777216"),
        ("PTS_PER_GROUP", "33554432", "from 1 to 16777216"),
        ("PTS_PER_GROUP", "2047", "multiple of PTS_PER_FRAME = 256"),
        ("FRAMES", "0", "1 frame or more"),
        ("FRAMES", "7.5", "whole number"),
        ("FRAMES", "2147483649", "from 0 to 2147483648"),
        ("HALF_FRAMES", "2", "from 0 to 1"),
        ("SCALE.CHAN_2", "inf", "one integer"),
        ("SCALE.CHAN_2", "1e305", "full scale"),
        ("SCALE.CHAN_2", "0.0", "0 makes every sample of the channel 0"),
        ("SCALE.CHAN_2", "-0", "a number other than 0"),
        ("SCALE.CHAN_2", "1e-400", "a number other than 0"),
        ("SAMPLES", "2049", "from 1 to 2048"),
        ("NUM_PARAMS", "1000", "from 3 to"),
        ("NUM_HEADER_BLOCKS", "0", "from 1 to 4096"),
        ("NUM_HEADER_BLOCKS", "4097", "from 1 to 4096"),
    ],
)
def test_a_value_that_is_not_allowed_is_named_with_its_place_and_what_was_expected(tmp_path, keyword, value, said):
    path = plain(tmp_path, rpc3_files.keywords(CHANNELS, **{keyword: value}))
    with pytest.raises(DriveFileError, match=said) as caught:
        read_rpc3(path)
    assert str(path) in str(caught.value)
    assert keyword in str(caught.value)
    assert path.read_bytes()[caught.value.offset :].startswith(value.encode("latin-1"))


@pytest.mark.parametrize("keyword", ["DELTA_T", "CHANNELS", "FRAMES", "PTS_PER_FRAME", "SCALE.CHAN_1"])
def test_a_keyword_that_is_missing_is_named(tmp_path, keyword):
    path = plain(tmp_path, rpc3_files.keywords(CHANNELS, **{keyword: "left out"}))
    with pytest.raises(DriveFileError, match=f"lacks {keyword}"):
        read_rpc3(path)


@pytest.mark.parametrize("kept", [0, 100, 383, 1000, 2560, 2561, 10000])
def test_a_file_that_was_cut_off_says_where_it_ends(tmp_path, kept):
    path = plain(tmp_path)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(DriveFileError) as caught:
        read_rpc3(path)
    assert caught.value.offset is not None
    assert caught.value.offset <= kept


def test_a_header_that_promises_more_than_the_file_holds_costs_no_memory(tmp_path):
    path = plain(tmp_path, rpc3_files.keywords(CHANNELS, FRAMES=2**31))
    with pytest.raises(DriveFileError, match="groups of 2 channels") as caught:
        read_rpc3(path)
    assert caught.value.offset == path.stat().st_size


def test_a_number_that_is_not_finite_is_named_with_channel_sample_and_byte(tmp_path):
    numbers = stored(2, 3000)
    numbers[1][2500] = float("nan")
    values = rpc3_files.keywords(CHANNELS, DATA_TYPE="FLOATING_POINT", FRAMES=12)
    path = plain(tmp_path, values, numbers, code="<f")
    with pytest.raises(DriveFileError, match="sample 2500 of left_lateral is nan") as caught:
        read_rpc3(path)
    assert np.isnan(struct.unpack_from("<f", path.read_bytes(), caught.value.offset)[0])


def test_a_file_that_is_something_else_or_not_there_is_refused(tmp_path):
    with pytest.raises(DriveFileError, match="FORMAT"):
        read_rpc3(write(tmp_path, b"PK\3\4" + bytes(2000)))
    with pytest.raises(DriveFileError, match="No such file"):
        read_rpc3(tmp_path / "none.rsp")
    with pytest.raises(DriveFileError, match="folder"):
        read_rpc3(tmp_path)


RECORDS = st.sampled_from(sorted(rpc3_files.keywords([("a", "N", "1"), ("b", "N", "1")])))
VALUES = st.one_of(
    st.integers().map(str), st.floats().map(str), st.text(st.characters(max_codepoint=255), max_size=40),
    st.sampled_from(["ASCII", "BINARY", "PEAK_PICK", "FLOATING_POINT", "1E99999999", "1" * 90, "left out"]),
)  # fmt: skip


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(st.dictionaries(RECORDS, VALUES, min_size=1, max_size=3))
def test_any_value_in_an_rpc3_header_is_read_or_refused_in_one_sentence(tmp_path, changes):
    path = tmp_path / "a.rsp"
    values = rpc3_files.keywords([("a", "N", "1"), ("b", "N", "1")]) | changes
    # The three that begin a header stay: without them it is none.
    values = {key: value for key, value in values.items() if value != "left out" or key in rpc3_files.FIRST}
    path.write_bytes(rpc3_files.header(values) + bytes(2 * 2 * 2048))
    try:
        said = f"{path}: {len(read_rpc3(path).names)}"
    except DriveFileError as error:
        said = str(error)
    assert said.startswith(str(path))
    assert "\n" not in said
    assert len(said) < 1000
