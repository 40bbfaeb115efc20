"""Arrays: what goes in comes out, and nothing hostile gets through."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from duralab_proto.arrays import LARGEST_RANK, ArrayError, from_array, from_record, to_array, to_record
from duralab_proto.v1 import array_pb2

SENDABLE = st.sampled_from([np.float64, np.float32, np.complex128, np.int64])
ARRAYS = SENDABLE.flatmap(
    lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5))
)


@given(ARRAYS)
def test_array_comes_back_bit_for_bit_over_the_wire(values):
    message = array_pb2.Array.FromString(to_array(values).SerializeToString())
    back = from_array(message, finite=False)
    assert back.dtype == values.dtype
    assert back.shape == values.shape
    assert back.tobytes() == values.tobytes()


@given(hnp.arrays(np.float64, (3, 4), elements=st.floats(allow_nan=False)))
def test_layout_and_byte_order_do_not_matter(values):
    for same in (np.asfortranarray(values), values.astype(">f8"), values[::-1][::-1]):
        assert to_array(same) == to_array(values)


def test_view_is_read_only_and_contiguous():
    back = from_array(to_array(np.ones((2, 3))))
    assert not back.flags.writeable
    assert back.flags.c_contiguous


@given(st.lists(st.integers(0, 2**64 - 1), max_size=5), st.binary(max_size=64))
def test_hostile_shape_never_gives_more_than_the_bytes_there_are(shape, data):
    message = array_pb2.Array(element_type=array_pb2.ELEMENT_TYPE_FLOAT64, shape=shape, data=data)
    with contextlib.suppress(ArrayError):
        values = from_array(message, finite=False)
        assert values.nbytes == len(data)
        assert list(values.shape) == shape


@pytest.mark.parametrize(
    "shape",
    [
        [2**32, 2**32],  # the product is 2^64, which wraps to 0
        [2**61 + 1],  # times 8 bytes wraps to 8
        [2**63, 0],  # empty, yet longer than numpy can say
        [1] * (LARGEST_RANK + 1),
    ],
)
def test_shape_whose_size_overflows_is_refused(shape):
    for data in (b"", bytes(8)):
        message = array_pb2.Array(element_type=array_pb2.ELEMENT_TYPE_FLOAT64, shape=shape, data=data)
        with pytest.raises(ArrayError, match="drive"):
            from_array(message, field="drive")


@pytest.mark.parametrize("length", [0, 47, 49, 96])
def test_wrong_number_of_bytes_is_refused_with_both_numbers(length):
    message = array_pb2.Array(element_type=array_pb2.ELEMENT_TYPE_FLOAT64, shape=[2, 3], data=bytes(length))
    with pytest.raises(ArrayError, match=rf"x\.y has {length} bytes; .* takes 48\.") as caught:
        from_array(message, field="x.y")
    assert caught.value.field == "x.y"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.complex128])
def test_value_that_is_not_finite_is_named_with_its_place(bad, dtype):
    values = np.zeros((2, 3), dtype)
    values[1, 2] = bad
    with pytest.raises(ArrayError, match=r"at index \(1, 2\)"):
        from_array(to_array(values))
    assert not np.isfinite(from_array(to_array(values), finite=False)).all()


@pytest.mark.parametrize("element_type", [0, 99])
def test_unknown_element_type_is_refused(element_type):
    with pytest.raises(ArrayError, match="element type"):
        from_array(array_pb2.Array(element_type=element_type, data=b""))


@pytest.mark.parametrize("shape", [(2,), (2, 4), (3, None), (2, 3, 1), ()])
def test_other_shape_than_expected_is_refused(shape):
    with pytest.raises(ArrayError, match="must be"):
        from_array(to_array(np.zeros((2, 3))), shape=shape)


def test_expected_shape_and_type_pass():
    assert from_array(to_array(np.zeros((2, 3))), shape=(2, None), dtype=float).shape == (2, 3)


def test_other_type_than_expected_is_refused():
    with pytest.raises(ArrayError, match="float32; it must be float64"):
        from_array(to_array(np.zeros(3, np.float32)), dtype=np.float64)


@pytest.mark.parametrize("dtype", [bool, np.int32, np.complex64, object, "U3"])
def test_type_that_the_contract_lacks_cannot_be_sent(dtype):
    with pytest.raises(ArrayError, match="cannot be sent"):
        to_array(np.zeros(3, dtype))


def channels(*names):
    return [array_pb2.Channel(name=name, unit="N") for name in names]


@given(hnp.arrays(np.float64, (2, 5), elements=st.floats(-1e9, 1e9)), st.floats(1e-3, 1e6))
def test_record_comes_back(samples, sample_rate):
    back_channels, back_rate, back = from_record(to_record(channels("a", "b"), sample_rate, samples))
    assert [channel.name for channel in back_channels] == ["a", "b"]
    assert back_rate == sample_rate
    assert np.array_equal(back, samples)


def record(samples, *names, sample_rate=1.0):
    return array_pb2.Record(channels=channels(*names), sample_rate=sample_rate, samples=to_array(samples))


@pytest.mark.parametrize(
    ("damaged", "field"),
    [
        (array_pb2.Record(), "drive.samples"),
        (record(np.zeros((0, 3)), sample_rate=0.0), "drive.sample_rate"),
        (record(np.zeros((0, 3)), sample_rate=np.nan), "drive.sample_rate"),
        (record(np.zeros((0, 3)), sample_rate=-1.0), "drive.sample_rate"),
        (record(np.zeros((0, 3)), sample_rate=np.inf), "drive.sample_rate"),
        (record(np.zeros(3)), "drive.samples"),
        (record(np.full((1, 3), np.nan), "a"), "drive.samples"),
        (record(np.zeros((1, 3), np.int64), "a"), "drive.samples"),
        (record(np.zeros((2, 3)), "a"), "drive.channels"),
        (record(np.zeros((1, 3)), ""), "drive.channels"),
        (record(np.zeros((2, 3)), "a", "a"), "drive.channels"),
    ],
)
def test_damaged_record_is_refused_with_its_field(damaged, field):
    with pytest.raises(ArrayError) as caught:
        from_record(damaged, field="drive")
    assert caught.value.field == field


def test_record_that_does_not_fit_together_is_not_made():
    with pytest.raises(ArrayError, match="1 channels and 2 rows"):
        to_record(channels("a"), 1000.0, np.zeros((2, 3)))
