"""RPC III files that are written are what the description says, and another reader agrees."""

import dataclasses
import itertools
import struct

import numpy as np
import pytest
import rpc3

from duralab_drive_files import (
    ByteOrder,
    DataType,
    DriveFileError,
    Rpc3Settings,
    TimeHistory,
    TimeType,
    open_rpc3,
    read_rpc3,
    write_rpc3,
)

rpc3.rpc3.progressbar = False


def some_signals(samples=5000, *, count=3, seed=0, rate=1000.0):
    rng = np.random.default_rng(seed)
    units = itertools.cycle(["N", "m/s^2", "µm"])
    names = tuple(f"left_{row}" for row in range(count))
    units = tuple(next(units) for _ in names)
    return TimeHistory(
        names, units, rate, rng.normal(size=(count, samples)) * 10.0 ** rng.integers(-6, 6, size=(count, 1))
    )


@pytest.mark.parametrize("half_frames", [False, True])
@pytest.mark.parametrize("byte_order", list(ByteOrder))
@pytest.mark.parametrize("data_type", list(DataType))
@pytest.mark.parametrize("points", [(256, 2048), (16384, 16384), (2048, 8192)])
def test_what_was_written_is_read_back_within_the_error_that_was_told(
    tmp_path, data_type, byte_order, points, half_frames
):
    signals = some_signals(32768 if half_frames else 5001)
    settings = Rpc3Settings(
        data_type=data_type,
        byte_order=byte_order,
        points_per_frame=points[0],
        points_per_group=points[1],
        half_frames=half_frames,
    )
    path = tmp_path / "a.rsp"
    written = write_rpc3(signals, path, settings)
    back = read_rpc3(path)
    assert back.names == signals.names
    assert back.units == signals.units
    assert back.sample_rate == signals.sample_rate
    assert back.samples.shape == signals.samples.shape
    np.testing.assert_array_equal(written.largest_errors, np.abs(back.samples - signals.samples).max(axis=1))
    peaks = np.abs(signals.samples).max(axis=1)
    allowed = peaks / 65504 * (1 + 1e-9) if data_type is DataType.SHORT_INTEGER else peaks * 2.0**-24
    assert (np.array(written.largest_errors) <= allowed).all()
    assert path.stat().st_size == open_rpc3(path).header.size + (signals.samples.shape[1] + written.padding) * 3 * (
        2 if data_type is DataType.SHORT_INTEGER else 4
    )


def test_the_bytes_are_those_of_the_description(tmp_path):
    signals = TimeHistory(("a", "b"), ("N", "mm"), 500.0, np.array([[32752.0, -16376.0], [0.0, 65504.0]]))
    path = tmp_path / "a.drv"
    written = write_rpc3(signals, path)
    content = path.read_bytes()
    assert [content[place : place + 32].rstrip(b"\0") for place in (0, 128, 256)] == [
        b"FORMAT",
        b"NUM_HEADER_BLOCKS",
        b"NUM_PARAMS",
    ]
    size = 512 * int(content[160:256].rstrip(b"\0"))
    assert len(content) == size + 2 * 2 * 2048
    assert struct.unpack_from("<3h", content, size) == (32752, -16376, 0)
    assert struct.unpack_from("<3h", content, size + 2 * 2048) == (0, 32752, 0)
    assert b"TIME_TYPE".ljust(32, b"\0") + b"DRIVE\0" in content
    assert b"FRAMES".ljust(32, b"\0") + b"1\0" in content
    for keyword, value in (("MAP.CHAN_2", "2"), ("UPPER_LIMIT.CHAN_1", "32752.0"), ("LOWER_LIMIT.CHAN_1", "-16376.0")):
        assert keyword.encode().ljust(32, b"\0") + value.encode() + b"\0" in content
    assert (written.padding, written.largest_errors) == (2046, (0.0, 0.0))


def test_a_given_full_scale_is_what_the_largest_integer_is_worth_and_nothing_beyond_it_is_written(tmp_path):
    history = TimeHistory(("a", "b"), ("mm", "kN"), 500.0, np.array([[80.0, -40.0], [0.5, 0.0]]))
    write_rpc3(history, tmp_path / "a.drv", full_scales=[100.0, 2.0])
    file = open_rpc3(tmp_path / "a.drv")
    np.testing.assert_allclose(file.scales * 32752, [100.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(file.read(), history.samples, atol=100.0 / 32752)
    with pytest.raises(DriveFileError, match="a reaches 80 mm; its full scale is 50 mm"):
        write_rpc3(history, tmp_path / "b.drv", full_scales=[50.0, 2.0])


@pytest.mark.parametrize("data_type", list(DataType))
@pytest.mark.parametrize("samples", [2048, 5001])
def test_rpc3_file_reads_what_was_written(tmp_path, data_type, samples):
    signals = some_signals(samples)
    path = tmp_path / "a.rsp"
    # It warns where frames do not fill a group, so a frame is as long as one.
    write_rpc3(signals, path, Rpc3Settings(data_type=data_type, points_per_frame=2048))
    channels, _ = rpc3.read(str(path))
    assert [(channel.name, channel.unit, channel.dt) for channel in channels] == [
        (name, unit, 0.001) for name, unit in zip(signals.names, signals.units, strict=True)
    ]
    ours = read_rpc3(path).samples
    # It returns single precision.
    np.testing.assert_array_equal(np.array([channel.data for channel in channels]), ours.astype(np.float32))


@pytest.mark.parametrize("datatype", [int, float])
@pytest.mark.parametrize("samples", [100, 5001])
def test_what_rpc3_file_writes_is_read(tmp_path, datatype, samples):
    signals = some_signals(samples)
    path = tmp_path / "a.rsp"
    rpc3.write(
        str(path),
        [
            rpc3.Channel(name, unit, 0.001, data)
            for name, unit, data in zip(signals.names, signals.units, signals.samples, strict=True)
        ],
        datatype=datatype,
    )
    back = read_rpc3(path)
    assert back.names == signals.names
    assert back.samples.shape == signals.samples.shape
    peaks = np.abs(signals.samples).max(axis=1, keepdims=True)
    assert (np.abs(back.samples - signals.samples) <= peaks * (1.6e-5 if datatype is int else 2.0**-24)).all()


def test_a_drive_and_a_response_are_told_apart_by_attribute_setting_and_suffix(tmp_path):
    signals = some_signals(10)

    def time_type(name, given=signals, settings=None):
        write_rpc3(given, tmp_path / name, settings)
        return read_rpc3(tmp_path / name).attributes["TIME_TYPE"]

    assert time_type("a.drv") == "DRIVE"
    assert time_type("a.rsp") == "RESPONSE"
    with_attribute = dataclasses.replace(signals, attributes={"TIME_TYPE": "mult_resp", "PARENT_1": "road.rsp"})
    assert time_type("a.rsp", with_attribute) == "MULT_RESP"
    assert time_type("a.tim", with_attribute) == "MULT_RESP"
    assert time_type("a.drv", with_attribute) == "DRIVE"
    assert read_rpc3(tmp_path / "a.drv").attributes["PARENT_1"] == "road.rsp"
    assert time_type("a.rsp", with_attribute, Rpc3Settings(time_type=TimeType.DRIVE)) == "DRIVE"


def test_the_same_signals_give_the_same_bytes_and_a_silent_channel_stays_silent(tmp_path):
    signals = some_signals(3000)
    signals.samples[1] = 0.0
    for name in ("a.rsp", "b.rsp"):
        write_rpc3(signals, tmp_path / name)
    assert (tmp_path / "a.rsp").read_bytes() == (tmp_path / "b.rsp").read_bytes()
    assert not read_rpc3(tmp_path / "a.rsp").samples[1].any()


@pytest.mark.parametrize(
    ("name", "said"),
    [("Ω" * 3, "Latin-1"), ("a" * 96, "95 characters"), ("a\0b", "NUL")],
)
def test_a_name_that_does_not_fit_is_refused_and_not_cut(tmp_path, name, said):
    with pytest.raises(DriveFileError, match=said) as caught:
        write_rpc3(TimeHistory((name,), ("N",), 100.0, np.ones((1, 10))), tmp_path / "a.rsp")
    assert str(caught.value).startswith("DESC.CHAN_1 is ")


def test_settings_and_signals_outside_the_description_are_refused(tmp_path):
    with pytest.raises(DriveFileError, match="points_per_frame is 1000"):
        Rpc3Settings(points_per_frame=1000)
    with pytest.raises(DriveFileError, match="multiple"):
        Rpc3Settings(points_per_frame=4096)
    with pytest.raises(DriveFileError, match="129 channels"):
        write_rpc3(some_signals(4, count=129), tmp_path / "a.rsp")
    with pytest.raises(DriveFileError, match="half frames"):
        write_rpc3(some_signals(4097), tmp_path / "a.rsp", Rpc3Settings(half_frames=True))
    for sample in (1e39, -1e39):
        with pytest.raises(DriveFileError, match="32-bit"):
            write_rpc3(
                TimeHistory(("a",), ("N",), 1.0, np.full((1, 3), sample)),
                tmp_path / "a.rsp",
                Rpc3Settings(data_type=DataType.FLOATING_POINT),
            )
