"""Damaged files of every format: signals or one sentence, never another exception, and bounded memory.

Mutations of valid files are drawn from seeds. DURALAB_FUZZ_EXAMPLES says how many for each format; `make fuzz` asks for
many more than the tests do, from DURALAB_FUZZ_SEED on.
"""

import os
import tracemalloc

import numpy as np
import pytest

from duralab import Channel, Signals
from duralab.formats import (
    Format,
    FormatError,
    FrequencyResponse,
    read_frequency_response,
    read_signals,
    write_frequency_response,
    write_signals,
)

EXAMPLES = int(os.environ.get("DURALAB_FUZZ_EXAMPLES", "12"))
FIRST_SEED = int(os.environ.get("DURALAB_FUZZ_SEED", "0"))
PIECE = 50
"""Mutations in one test, so that workers share them."""

LARGEST_MEMORY = 96 << 20
"""Bytes; what a library sets up when it is first used is in it, but not the size that a damaged header announces."""

NUMBERS = (b"0", b"-1", b"nan", b"1e999", b"99999999999", b"2147483648", b"0.5", b"", b"x")


def mutated(content, seed):
    """Return bytes that differ from valid ones in 1 to 4 places, or end early."""
    rng = np.random.default_rng(seed)
    data = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        kind, place = rng.integers(7), int(rng.integers(len(data) or 1))
        if rng.random() < 0.5:
            # Headers lie at the start and, in some formats, at the end.
            place = place % 1500 if rng.random() < 0.7 else max(0, len(data) - 1 - place % 800)
        length = int(2 ** rng.uniform(0, 9))
        if kind == 0:
            del data[place:]
        elif kind == 1:
            data[place : place + length] = rng.bytes(length)
        elif kind == 2:
            data[place : place + 1] = bytes([int(rng.integers(256))])
        elif kind == 3:
            data[place : place + min(length, 8)] = rng.choice([b"\0", b"\xff", b"\x7f"]) * min(length, 8)
        elif kind == 4:
            del data[place : place + length]
        elif kind == 5:
            data[place:place] = data[place : place + length]
        else:
            data[place : place + len(number)] = (number := NUMBERS[int(rng.integers(len(NUMBERS)))])
        if not data:
            break
    return bytes(data)


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """Return the bytes of a valid file of each format."""
    folder = tmp_path_factory.mktemp("valid")
    rng = np.random.default_rng(0)
    signals = Signals((Channel("a", "N"), Channel("b", "mm")), 256.0, rng.normal(size=(2, 300)), {"SITE": "here"})
    contents = {}
    for form in Format:
        write_signals(signals, folder / form, format=form)
        contents[form] = (folder / form).read_bytes()
    return contents


def read_and_judge(read, path):
    """Fail where reading raises anything but one sentence that names the file."""
    said = f"{path}: nothing"
    try:
        read(path)
    except FormatError as error:
        said = error.message
    assert said.startswith(str(path))
    assert "\n" not in said
    assert len(said) < 1000


@pytest.mark.parametrize("piece", range(-(-EXAMPLES // PIECE)))
@pytest.mark.parametrize("form", Format)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(tmp_path, valid, form, piece):
    path = tmp_path / "damaged"
    for seed in range(piece * PIECE, min(EXAMPLES, (piece + 1) * PIECE)):
        path.write_bytes(mutated(valid[form], FIRST_SEED + seed))
        try:
            read_and_judge(lambda p: read_signals(p, format=form), path)
        except Exception as error:
            raise AssertionError(f"seed {FIRST_SEED + seed} of {form}") from error


@pytest.mark.parametrize("form", Format)
def test_a_damaged_file_takes_no_more_memory_than_a_sound_one_may(tmp_path, valid, form):
    path = tmp_path / "damaged"
    path.write_bytes(valid[form])
    read_signals(path, format=form)
    tracemalloc.start()
    try:
        for seed in range(FIRST_SEED, FIRST_SEED + EXAMPLES // 3):
            path.write_bytes(mutated(valid[form], seed))
            tracemalloc.reset_peak()
            read_and_judge(lambda p: read_signals(p, format=form), path)
            assert tracemalloc.get_traced_memory()[1] < LARGEST_MEMORY, f"seed {seed}"
    finally:
        tracemalloc.stop()


def test_damaged_frequency_responses_are_read_or_refused_in_one_sentence(tmp_path):
    path = tmp_path / "h.uff"
    channels = (Channel("a", "N"), Channel("b", "N"))
    write_frequency_response(FrequencyResponse(channels, channels, np.arange(20.0), np.ones((20, 2, 2)) + 0j), path)
    content = path.read_bytes()
    for seed in range(FIRST_SEED, FIRST_SEED + EXAMPLES):
        path.write_bytes(mutated(content, seed))
        read_and_judge(read_frequency_response, path)
