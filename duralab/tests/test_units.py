"""Units are converted by their exact definitions; what is not known or not alike is refused."""

import math

import numpy as np
import pytest

from duralab import Channel, InputError, Signals
from duralab.formats import SI_UNITS, convert_units


def one(unit, value=1.0, name="x"):
    return Signals((Channel(name, unit, minimum=-2.0, maximum=3.0),), 100.0, np.array([[value, 0.0]]))


@pytest.mark.parametrize(
    ("given", "wanted", "factor"),
    [
        ("kN", "N", 1e3),
        ("mm", "m", 1e-3),
        ("g", "m/s^2", 9.80665),
        ("m/s²", "g", 1 / 9.80665),
        ("deg", "rad", math.pi / 180),
        ("°/s", "rad/s", math.pi / 180),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("km/h", "m/s", 1 / 3.6),
        ("bar", "Pa", 1e5),
        ("MPa", "bar", 10.0),
        ("kNm", "N*m", 1e3),
        ("Nm", "N*m", 1.0),
        ("µm/m", "1", 1e-6),
        ("microstrain", "1", 1e-6),
        ("lbf", "N", 4.4482216152605),
        ("inch", "mm", 25.4),
        # Factors of thousand, and exact definitions: 1 lb = 0.45359237 kg, 1 ft = 0.3048 m, 1 in = 0.0254 m.
        ("mg", "m/s^2", 9.80665e-3),
        ("mG", "m/s^2", 9.80665e-3),
        ("ug", "m/s^2", 9.80665e-6),
        ("µg", "m/s^2", 9.80665e-6),
        ("μg", "m/s^2", 9.80665e-6),
        ("milligram", "kg", 1e-6),
        ("g^2/Hz", "(m/s^2)**2/Hz", 9.80665**2),
        ("mV/g", "V/(m/s^2)", 1e-3 / 9.80665),
        ("mm/s2", "m/s^2", 1e-3),
        ("mm2", "m^2", 1e-6),
        ("KN", "N", 1e3),
        ("mNm", "N*m", 1e-3),
        ("daNm", "N*m", 10.0),
        ("MNm", "N*m", 1e6),
        ("kN-m", "N*m", 1e3),
        ("N/Nm", "1/m", 1.0),
        ("Nm/deg", "N*m/rad", 180 / math.pi),
        ("Ns/m", "kg/s", 1.0),
        ("RPM", "rad/s", 2 * math.pi / 60),
        ("Deg", "rad", math.pi / 180),
        ("DEG", "rad", math.pi / 180),
        ("uE", "1", 1e-6),
        ("µE", "1", 1e-6),
        ("ft-lb", "N*m", 0.3048 * 0.45359237 * 9.80665),
        ("lbf-ft", "N*m", 0.3048 * 0.45359237 * 9.80665),
        ("in-lb", "N*m", 0.0254 * 0.45359237 * 9.80665),
    ],
)
def test_a_unit_is_converted_by_its_definition(given, wanted, factor):
    converted = convert_units(one(given), [wanted])
    assert converted.samples[0, 0] == pytest.approx(factor, rel=1e-12)
    assert converted.samples[0, 1] == 0.0
    channel = converted.channels[0]
    assert channel.unit == wanted
    assert (channel.minimum, channel.maximum) == pytest.approx((-2 * factor, 3 * factor), rel=1e-12)


def test_temperatures_have_an_offset():
    np.testing.assert_allclose(convert_units(one("°C", 20.0), ["K"]).samples, [[293.15, 273.15]])


def test_each_channel_takes_the_unit_of_its_kind_and_the_given_ones_stay():
    given = Signals((Channel("a", "kN"), Channel("b", "mm"), Channel("c", "N")), 10.0, np.ones((3, 2)))
    converted = convert_units(given)
    assert [channel.unit for channel in converted.channels] == ["N", "m", "N"]
    np.testing.assert_array_equal(converted.samples[:, 0], [1e3, 1e-3, 1.0])
    np.testing.assert_array_equal(given.samples, np.ones((3, 2)))
    named = convert_units(given, {"b": "cm"})
    assert [channel.unit for channel in named.channels] == ["kN", "cm", "N"]


def test_the_units_of_a_lab_are_those_of_themselves():
    for unit in SI_UNITS:
        np.testing.assert_array_equal(convert_units(one(unit, 1.25)).samples, [[1.25, 0.0]])


@pytest.mark.parametrize("unit", ["quux", "((", "m**2/", "__import__('os')", "9" * 5000, "N-", "ÿÿ"])
def test_a_unit_that_is_not_known_is_named(unit):
    with pytest.raises(InputError, match="of x is not known"):
        convert_units(one(unit))


@pytest.mark.parametrize(
    ("unit", "meant"),
    # Peta-ampere, pico-year, mega-molar and atto-newton: pint reads each, and no channel has such a unit.
    [("PA", "Pa"), ("pa", "Pa"), ("MM", "mm"), ("MPA", "MPa"), ("hz", "Hz"), ("aN", None), ("ma", None), ("cg", None)],
)
def test_a_unit_that_no_file_means_is_refused_with_the_one_that_is_meant(unit, meant):
    with pytest.raises(InputError, match="of x is not known") as caught:
        convert_units(one(unit))
    assert ("did you mean" in str(caught.value)) == (meant is not None)
    assert meant is None or f"(did you mean {meant}?)" in str(caught.value)


@pytest.mark.parametrize(
    ("given", "wanted", "said"),
    [
        ("N", {"x": "m"}, "cannot be converted to 'm'"),
        ("rpm", {"x": "Hz"}, "cannot be converted"),
        ("microstrain", {"x": "rad"}, "cannot be converted"),
        ("N", {"y": "N"}, "no channel y; there are x"),
        ("N", ["m", "mm"], "none of m, mm"),
        ("", ["N"], "names no unit"),
    ],
)
def test_what_does_not_fit_together_is_said(given, wanted, said):
    with pytest.raises(InputError, match=said):
        convert_units(one(given), wanted)
