from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from duralab_roads import RoadFileError, effective_inputs, level, read_opencrg, repeat_mirrored

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the measured roads in ../shared/data are not here")

HEIGHTS = np.round(np.random.default_rng(2).uniform(-0.2, 0.2, (6, 9)), 5)
HEIGHTS[2, 0] = np.nan
TEXT = {"LRFI": (10, 8, " {:.7f}"), "LDFI": (20, 4, " {:.15f}")}
BINARY = {"KRBI": (">f4", 20), "KDBI": (">f8", 10)}


def _file(data_format="LRFI", *, heights=HEIGHTS, rows=None, parameters="", definition=None, blocks="", heading=None):
    rows, columns = (heights.shape[0] if rows is None else rows), heights.shape[1]
    channels = ["D:reference line phi,rad"] if heading is not None else []
    channels += [f"D:long section {index + 1},m  ! a comment" for index in range(columns)]
    header = (
        "$CT\nA road made by a test: $ROAD_CRG is not this line.\n$\n$ROAD_CRG   ! parameters\n* a comment\n"
        "reference_line_start_u = 5.0\n"
        f"REFERENCE_LINE_END_U = {5.0 + 0.5 * (rows - 1)}\nREFERENCE_LINE_INCREMENT = 0.5\n"
        f"LONG_SECTION_V_RIGHT = -2.0\nLONG_SECTION_V_LEFT=2.0\nLONG_SECTION_V_INCREMENT = {4.0 / (columns - 1)}\n"
        f"{parameters}$\n{blocks}$KD_Definition\n#:{data_format}\nU:reference line u,m,0,0.5\n"
        + "\n".join(channels if definition is None else definition)
        + "\n$\n"
        + "$" * 80
        + "\n"
    ).encode("latin-1")
    values = heights if heading is None else np.column_stack([heading, heights])
    if data_format in BINARY:
        kind, per_record = BINARY[data_format]
        padded = np.full(-(-values.size // per_record) * per_record, np.nan)
        padded[: values.size] = values.ravel()
        return header + padded.astype(kind).tobytes()
    width, per_record, layout = TEXT.get(data_format, TEXT["LRFI"])
    lines = []
    for row in values:
        fields = ["*missing*".rjust(width) if np.isnan(z) else layout.format(z)[:width].rjust(width) for z in row]
        lines += ["".join(fields[start : start + per_record]) for start in range(0, len(fields), per_record)]
    return header + "\n".join(lines).encode() + b"\n"


@pytest.fixture
def read(tmp_path):
    def write_and_read(content, **options):
        path = tmp_path / "road.crg"
        path.write_bytes(content)
        return read_opencrg(path, **options)

    return write_and_read


@pytest.mark.parametrize("data_format", [*TEXT, *BINARY])
@pytest.mark.parametrize("heading", [None, np.linspace(2.0, 2.01, 6)])
def test_every_format_gives_the_same_grid(read, data_format, heading):
    road = read(_file(data_format, heading=heading))
    np.testing.assert_allclose(road.elevation, HEIGHTS, atol=1e-8 if data_format != "LDFI" else 1e-12)
    np.testing.assert_allclose(road.lateral_positions, np.linspace(-2, 2, 9))
    assert road.spacing == 0.5


def test_columns_may_be_named_by_position_in_any_order(read):
    definition = [f"D:long section at v = {v},m" for v in (1.5, -1.5, 0.25)]
    road = read(_file(heights=HEIGHTS[:, 1:4], definition=definition))
    np.testing.assert_array_equal(road.lateral_positions, [-1.5, 0.25, 1.5])
    np.testing.assert_allclose(road.elevation, HEIGHTS[:, [2, 3, 1]])


def test_text_may_leave_out_its_length_and_use_dos_line_ends(read):
    content = _file().replace(b"REFERENCE_LINE_END_U = 7.5\n", b"").replace(b"\n", b"\r\n")
    np.testing.assert_allclose(read(content).elevation, HEIGHTS)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", r"byte 0: expected a header"),
        (b"\x00" * 10_000, r"byte 0: expected a header"),
        (b"PK\x03\x04 no road\n" * 100, "expected a header"),
        (_file()[:200], "expected a header"),
        (_file("KRBI")[:-80], "expected 216 bytes of data"),
        (_file("KRBI") + b"\x00", "found 241"),
        (_file("KRBI").replace(b"\n", b"\r\n") + b"\r" * 30, "bytes of data"),
        (_file("LRFI")[:-30], "expected 8 numbers of 10 characters"),
        (_file("LRFI", rows=7), "expected 7 whole rows of data, found 6"),
        (_file("LRFI", rows=5), "at most 5 rows"),
        (_file("LRFI").replace(b"*missing*", b"*missi\n  "), "numbers of 10 characters"),
        (_file("LRFI").replace(b"*missing*", b" 1.2.3   "), "expected a number"),
        (_file("XXXX"), "'XXXX' is not supported"),
        (_file(definition=[]), "data channels"),
        (_file(definition=["D:reference line phi,rad"]), "long section"),
        (_file(definition=["D:long section 1,m", "D:long section 2,m"]), "do not reach"),
        (_file(definition=["D:long section at v = x,m"] * 9), "lateral position"),
        (_file(parameters="REFERENCE_LINE_INCREMENT = 0\n"), "REFERENCE_LINE_INCREMENT above 0"),
        (_file(parameters="REFERENCE_LINE_INCREMENT = 0.37\n"), "whole number of increments"),
        (_file(parameters="REFERENCE_LINE_END_U = 1e300\n"), "announces"),
        (_file(parameters="REFERENCE_LINE_END_U = nan\n"), "finite number"),
        (_file(parameters="REFERENCE_LINE_END_U\n"), "NAME = finite number"),
        (_file("KDBI", parameters="REFERENCE_LINE_END_U = 1e12\n"), "more than the 50000000"),
        (_file(parameters="REFERENCE_LINE_END_S = 0.02\n"), "slope"),
        (_file(parameters="REFERENCE_LINE_START_B = 0.02\n"), "banking"),
        (_file(blocks="$ROAD_CRG_MODS\nSCALE_Z_GRID = 2\n$\n"), r"\$ROAD_CRG_MODS is not supported"),
        (_file(blocks="$ROAD_CRG_FILE\nother.crg\n$\n"), r"\$ROAD_CRG_FILE is not supported"),
        (_file(heading=np.linspace(0.0, 0.5, 6)), "turns with 0.2 rad/m"),
    ],
)
def test_a_damaged_or_unsupported_file_is_refused_with_file_offset_and_expectation(read, content, expected):
    with pytest.raises(RoadFileError, match=expected) as caught:
        read(content)
    assert str(caught.value).startswith(f"road.crg, byte {caught.value.offset}: ")


def test_a_large_grid_is_refused_before_it_is_read(read):
    with pytest.raises(RoadFileError, match="6 x 9 values, more than the 50"):
        read(_file("KRBI"), maximum_cells=50)
    with pytest.raises(RoadFileError, match="at most 5 rows"):
        read(_file().replace(b"REFERENCE_LINE_END_U = 7.5\n", b""), maximum_cells=50)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data_format=st.sampled_from([*TEXT, *BINARY]),
    cut=st.integers(0, 1400),
    spots=st.lists(st.tuples(st.integers(0, 1400), st.binary(min_size=1, max_size=4)), max_size=4),
)
def test_no_damage_gets_past_the_reader_as_anything_but_a_road_or_its_error(read, data_format, cut, spots):
    content = bytearray(_file(data_format))
    for at, replacement in spots:
        content[at : at + len(replacement)] = replacement
    try:
        road = read(bytes(content[: max(cut, 600)]))
    except RoadFileError:
        return
    assert road.elevation.shape[1] == road.lateral_positions.size


@needs_data
def test_the_handmade_example_of_the_standard_is_read():
    road = read_opencrg(DATA / "handmade_straight.crg")
    assert road.spacing == 1.0
    np.testing.assert_allclose(road.lateral_positions, np.arange(-1.5, 1.6, 0.5))
    assert road.elevation.shape == (23, 7)
    assert np.isnan(road.elevation).sum() == 3
    assert road.elevation[15, 6] == -0.0333333


@needs_data
def test_the_measured_belgian_block_is_read_and_driven():
    road = read_opencrg(DATA / "belgian_block.crg")
    assert road.elevation.shape == (1001, 341)
    assert road.length == pytest.approx(10.0)
    assert (np.nanmin(road.elevation), np.nanmax(road.elevation)) == pytest.approx((2.035, 2.183), abs=1e-3)
    inputs = effective_inputs(
        repeat_mirrored(level(road), 80.0),
        speed=15.0,
        sample_rate=1000.0,
        samples=5001,
        track_width=1.5,
        tyre_radius=0.32,
        contact_length=0.12,
        contact_width=0.2,
        lead_in_seconds=0.5,
    )
    assert np.all(np.isfinite(inputs))
    assert 0.01 < inputs[0].std() < 0.03
    with pytest.raises(ValueError, match="NaN"):
        effective_inputs(
            road,
            speed=5.0,
            sample_rate=1000.0,
            samples=1901,
            track_width=3.2,
            tyre_radius=0.32,
            contact_length=0.12,
            contact_width=0.2,
            lead_in_seconds=0.5,
        )
