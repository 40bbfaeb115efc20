"""Signals to xarray and back, and drives told by name."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

from duralab.data import Channel, Rig, Signals
from duralab.errors import InputError
from duralab.lab.playing import drive_signals

CHANNELS = (Channel("a", "m", maximum=1.0, minimum=-1.0, label="stroke"), Channel("b", "N"))
SIGNALS = Signals(CHANNELS, 500.0, np.random.default_rng(1).standard_normal((2, 400)))
RIG = Rig(
    name="rig",
    specimen="",
    engine="",
    version="",
    sample_rate=500.0,
    drives=CHANNELS,
    responses=(),
    longest_drive_seconds=10.0,
    static_response=np.zeros(0),
    content_hash="",
)


def dataset(signals: Signals = SIGNALS) -> xarray.Dataset:
    return xarray.Dataset(
        {
            channel.name: ("time", row, {"units": channel.unit})
            for channel, row in zip(signals.channels, signals.samples, strict=True)
        },
        coords={"time": signals.time},
    )


@pytest.mark.parametrize("labelled", [SIGNALS.to_xarray(), SIGNALS.to_xarray().T, dataset()])
def test_what_goes_to_xarray_comes_back(labelled):
    back = Signals.from_xarray(labelled)
    assert back.names == SIGNALS.names
    assert [channel.unit for channel in back.channels] == ["m", "N"]
    assert back.sample_rate == SIGNALS.sample_rate
    np.testing.assert_array_equal(back.samples, SIGNALS.samples)


@pytest.mark.parametrize("rate", [500.0, 1000.0 / 3.0, 204.8])
def test_the_rate_comes_from_the_time_where_nothing_else_tells_it(rate):
    labelled = Signals(CHANNELS, rate, SIGNALS.samples).to_xarray()
    del labelled.attrs["sample_rate"]
    assert Signals.from_xarray(labelled).sample_rate == pytest.approx(rate, abs=1e-6)


@pytest.mark.parametrize(
    ("labelled", "part"),
    [
        (xarray.DataArray(np.zeros((2, 3)), dims=("x", "time")), "dimensions x, time; needed are channel, time"),
        (xarray.DataArray(np.zeros((2, 3)), dims=("channel", "time")), "no names"),
        (xarray.DataArray(np.zeros((1, 3)), dims=("channel", "time"), coords={"channel": ["a"]}), "not told"),
        (
            xarray.DataArray(
                np.zeros((1, 3)), dims=("channel", "time"), coords={"channel": ["a"], "time": [0.0, 0.1, 0.3]}
            ),
            "not even",
        ),
        (xarray.Dataset(), "no variable"),
        (xarray.Dataset({"a": (("time", "run"), np.zeros((2, 2)))}), "'a' has the dimensions time, run"),
    ],
)
def test_labels_that_do_not_say_enough_are_refused(labelled, part):
    with pytest.raises(InputError, match=part):
        Signals.from_xarray(labelled)


@pytest.mark.parametrize("drive", [SIGNALS.to_xarray()[::-1], dataset()[["b", "a"]], dataset()])
def test_a_drive_with_names_may_have_them_in_any_order(drive):
    ordered = drive_signals(drive, RIG)
    assert ordered.channels == CHANNELS
    np.testing.assert_array_equal(ordered.samples, SIGNALS.samples)


def test_another_unit_and_other_names_are_left_for_the_rig_to_refuse():
    millimetres = (Channel("b", "N"), Channel("a", "mm"))
    assert drive_signals(Signals(millimetres, 500.0, SIGNALS.samples), RIG).channels[0].unit == "mm"
    other = Signals((Channel("c", "m"), CHANNELS[1]), 500.0, SIGNALS.samples)
    assert drive_signals(other, RIG) is other


@pytest.mark.parametrize("unit", ["", " "])
def test_a_drive_with_names_and_no_unit_is_refused(unit):
    channels = (Channel("b", "N"), Channel("a", unit))
    for drive in (Signals(channels, 500.0, SIGNALS.samples), Signals(channels, 500.0, SIGNALS.samples).to_xarray()):
        with pytest.raises(InputError, match=r"names no unit for a; rig 'rig' takes m, so") as caught:
            drive_signals(drive, RIG)
        assert caught.value.field == "drive.unit"


def test_a_drive_as_signals_is_checked_as_others_are():
    single = drive_signals(Signals(CHANNELS, 500.0, SIGNALS.samples.astype(np.float32)), RIG)
    np.testing.assert_array_equal(single.samples, SIGNALS.samples.astype(np.float32).astype(np.float64))
    assert single.samples.dtype == np.float64
    for samples in (SIGNALS.samples[:1], SIGNALS.samples[0]):
        with pytest.raises(InputError) as caught:
            drive_signals(Signals(CHANNELS, 500.0, samples), RIG)
        assert caught.value.field.startswith("record")


@pytest.mark.parametrize(
    ("samples", "held"),
    [
        (SIGNALS.samples * (1 + 1j), "complex numbers"),
        (SIGNALS.samples > 0, "truth values"),
        (SIGNALS.samples.astype(str), "text"),
        (SIGNALS.samples.astype(bytes), "bytes"),
        (SIGNALS.samples.astype(object), "values of type object"),
    ],
)
def test_a_drive_that_is_not_of_real_numbers_is_refused(samples, held):
    told = replace(SIGNALS, samples=samples)
    labelled = (told.to_xarray(), told.to_xarray().drop_vars("channel"), dataset(told))
    # A drive out of xarray is refused where it is read, with the name of the variable where it has one.
    for drive in (samples, told, *labelled):
        with pytest.raises(InputError, match=f"holds {held}; give an array of real numbers") as caught:
            drive_signals(drive, RIG)
        assert caught.value.field == "drive.samples"


def test_a_drive_with_masked_values_is_refused():
    with pytest.raises(InputError, match="The drive has 1 masked values, which are no numbers; fill them in"):
        drive_signals(np.ma.masked_equal(SIGNALS.samples, SIGNALS.samples[1, 2]), RIG)
    np.testing.assert_array_equal(drive_signals(np.ma.array(SIGNALS.samples), RIG).samples, SIGNALS.samples)


def test_a_drive_whose_unit_would_be_lost_is_refused():
    class Quantity:
        """What pint and astropy make: numbers behind `__array__`, with their unit beside them."""

        def __init__(self, name: str) -> None:
            setattr(self, name, "mm")

        def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
            return SIGNALS.samples

    unnamed = xarray.DataArray(SIGNALS.samples, dims=("channel", "time"), attrs={"units": "mm"})
    for drive in (Quantity("units"), Quantity("unit"), unnamed):
        with pytest.raises(
            InputError, match="The drive carries the unit mm, which is read of named channels only"
        ) as caught:
            drive_signals(drive, RIG)
        assert caught.value.field == "drive.samples"
    in_each = unnamed.assign_coords(unit=("channel", ["mm", "mm"])).drop_attrs()
    with pytest.raises(InputError, match="The drive carries units, which"):
        drive_signals(in_each, RIG)


@pytest.mark.parametrize("kind", [np.int16, np.uint8, np.float32, ">f8"])
def test_real_numbers_of_every_kind_become_float64(kind):
    given = np.arange(8).reshape(2, 4).astype(kind)
    for drive in (given, given.tolist(), replace(SIGNALS, samples=given)):
        played = drive_signals(drive, RIG).samples
        assert played.dtype == np.float64
        np.testing.assert_array_equal(played, given)


def test_an_array_without_names_is_taken_in_the_order_of_the_rig():
    unnamed = xarray.DataArray(SIGNALS.samples, dims=("channel", "time"))
    np.testing.assert_array_equal(drive_signals(unnamed, RIG).samples, SIGNALS.samples)
    with pytest.raises(InputError, match=r"needs \(2, samples\): a, b"):
        drive_signals(unnamed[:1], RIG)
