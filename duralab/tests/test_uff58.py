"""Universal files as pyuff writes and reads them, and the frequency responses of a rig."""

import numpy as np
import pytest
import pyuff

from duralab import Channel, InputError
from duralab.formats import (
    FormatError,
    FrequencyResponse,
    read_frequency_response,
    read_signals,
    write_frequency_response,
    write_signals,
)

DRIVES = (Channel("left", "m"), Channel("right", "m"))
RESPONSES = (Channel("force", "N"), Channel("acceleration", "m/s^2"), Channel("strain", "1"))


def response(lines=50):
    rng = np.random.default_rng(3)
    shape = (lines, 3, 2)
    return FrequencyResponse(
        DRIVES, RESPONSES, 0.5 + 0.25 * np.arange(lines), rng.normal(size=shape) + 1j * rng.normal(size=shape)
    )


def test_a_frequency_response_matrix_comes_back_with_phase_channels_and_units(tmp_path):
    given, path = response(), tmp_path / "h.uff"
    write_frequency_response(given, path)
    back = read_frequency_response(path)
    np.testing.assert_array_equal(back.frf, given.frf)
    np.testing.assert_allclose(back.frequency, given.frequency, rtol=1e-9)
    assert [(c.name, c.unit) for c in back.drives + back.responses] == [(c.name, c.unit) for c in DRIVES + RESPONSES]


def test_pyuff_reads_response_reference_type_and_units(tmp_path):
    given, path = response(), tmp_path / "h.uff"
    write_frequency_response(given, path)
    sets = pyuff.UFF(str(path)).read_sets()
    assert len(sets) == 6
    assert [(one["rsp_node"], one["ref_node"]) for one in sets] == [(r, u) for r in (1, 2, 3) for u in (1, 2)]
    assert {one["func_type"] for one in sets} == {4}
    assert (sets[3]["ordinate_axis_units_lab"].strip(), sets[3]["orddenom_axis_units_lab"].strip()) == ("m/s^2", "m")
    np.testing.assert_array_equal(sets[3]["data"], given.frf[:, 1, 1])
    np.testing.assert_allclose(sets[3]["x"], given.frequency, rtol=1e-9)


def test_time_histories_in_text_are_read_too(tmp_path):
    path = tmp_path / "a.uff"
    data = np.random.default_rng(0).normal(size=333)
    dataset = pyuff.prepare_58(
        func_type=1, rsp_node=1, rsp_dir=1, ref_node=0, ref_dir=0, data=data, x=np.arange(333) / 512, id1="wheel",
        num_pts=333, abscissa_spacing=1, abscissa_inc=1 / 512, abscissa_min=0.0, ordinate_axis_units_lab="kN",
        ordinate_spec_data_type=9, abscissa_spec_data_type=17, orddenom_spec_data_type=0, binary=0, ord_data_type=4,
    )  # fmt: skip
    pyuff.UFF(str(path)).write_sets([dataset])
    signals = read_signals(path)
    assert (signals.names, signals.channels[0].unit, signals.sample_rate) == (("wheel",), "kN", 512.0)
    np.testing.assert_allclose(signals.samples[0], data, rtol=1e-10)
    with pytest.raises(FormatError, match="no frequency response"):
        read_frequency_response(path)


def test_what_does_not_fit_is_refused(tmp_path):
    holes = response()
    holes.frf[3, 0, 0] = np.nan
    with pytest.raises(InputError, match="not identified"):
        write_frequency_response(holes, tmp_path / "h.uff")
    uneven = response()
    uneven.frequency[4] += 0.01
    with pytest.raises(InputError, match="evenly spaced"):
        write_frequency_response(uneven, tmp_path / "h.uff")
    from duralab import Signals

    for channel in (Channel("a" * 81, "N"), Channel("ä", "N"), Channel("a", "N" * 21), Channel("a\nb", "N")):
        with pytest.raises(InputError, match="ASCII characters"):
            write_signals(Signals((channel,), 10.0, np.ones((1, 5))), tmp_path / "a.uff")


def test_a_rate_that_six_digits_do_not_tell_is_said(tmp_path):
    from duralab import Signals

    written = write_signals(Signals((Channel("a", "N"),), 1000 / 3 + 0.001, np.ones((1, 5))), tmp_path / "a.uff")
    assert "six digits" in written.notes[0]


@pytest.mark.parametrize("kept", [-1000, -500, -9, -5, -2])
@pytest.mark.parametrize("line_end", [b"\n", b"\r\n"])
def test_a_file_that_ends_in_its_last_dataset_is_refused(tmp_path, kept, line_end):
    from duralab import Signals

    path = tmp_path / "a.uff"
    write_signals(Signals((Channel("a", "N"), Channel("b", "N")), 10.0, np.ones((2, 50))), path)
    sound = path.read_bytes().replace(b"    -1\n", b"    -1" + line_end)
    for end in (b"", b" " * 74 + b"\n", b"\n\n"):
        path.write_bytes(sound.removesuffix(line_end) + end)
        assert read_signals(path).names == ("a", "b")
    path.write_bytes(sound.removesuffix(line_end)[:kept])
    with pytest.raises(FormatError, match="the last dataset is not closed by a line '-1'") as caught:
        read_signals(path)
    assert caught.value.offset == path.stat().st_size


def text_set(name, *, start=0.0, kind=17, unit="s", ordinates=4):
    return "\n".join(
        [
            f"{-1:6d}", f"{58:6d}", *(f"{text:<80}" for text in (name, "NONE", "NONE", "NONE", "NONE")),
            f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':<10}{1:10d}{1:4d} {'NONE':<10}{0:10d}{0:4d}",
            f"{ordinates:10d}{2:10d}{1:10d}{start:13.5e}{0.005:13.5e}{0.0:13.5e}",
            f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit:<20}",
            *(f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}" for _ in range(3)),
            "".join(f"{value:20.12e}" for value in np.arange(2 if ordinates == 4 else 4)),
            f"{-1:6d}\n",
        ]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"start": 10.0}, "'a' starts at 0.0 s and 'b' at 10.0 s; one start for all channels was expected"),
        ({"unit": "ms"}, "the axis of 'b' is 'ms'; time in seconds was expected"),
        ({"unit": "Hz", "kind": 18}, r"the axis of 'b' is 'Hz \(type 18\)'"),
        ({"unit": "", "kind": 18}, r"the axis of 'b' is '\(type 18\)'"),
        ({"ordinates": 6}, "the samples of 'b' are complex; real ones were expected"),
    ],
)
def test_time_histories_without_one_time_in_seconds_or_complex_are_refused(tmp_path, changes, said):
    path = tmp_path / "a.uff"
    for unit, kind in (("s", 17), ("NONE", 17), ("SEC", 0), ("", 1)):
        path.write_text(text_set("a") + text_set("b", unit=unit, kind=kind))
        np.testing.assert_array_equal(read_signals(path).samples, [[0.0, 1.0]] * 2)
    path.write_text(text_set("a") + text_set("b", **changes))
    with pytest.raises(FormatError, match=said):
        read_signals(path)
