"""Bits that flipped in a file that a kill left without an end: none is taken for the end while others follow it."""

from __future__ import annotations

import contextlib
import random

import pytest
from mcap.opcode import Opcode

from duralab_recordings import DAMAGE, MAGIC, scan
from recorder.format import Content
from recorder.log import Archive
from recorder.refused import RefusedError


@pytest.fixture
def killed(tmp_path, campaign, step_of):
    """A file of several chunks as a kill leaves it."""
    archive = Archive(tmp_path, least_free_bytes=0)
    messages = [campaign.specification(), campaign.description(), campaign.model(), campaign.iteration(1, 0.5)]
    messages += [campaign.planned(f"demo.i{number:02d}") for number in range(4, 12)]
    for number, message in enumerate(messages):
        archive.commit("demo", step_of(number, message))
    content = (tmp_path / "demo.mcap").read_bytes()
    archive.close()
    (tmp_path / "demo.mcap").write_bytes(content)
    return tmp_path / "demo.mcap"


def records_of(content):
    """Return where each record of the file begins, its kind and its length."""
    found, position = [], len(MAGIC)
    while position < len(content):
        length = int.from_bytes(content[position + 1 : position + 9], "little")
        found.append((position, content[position], length))
        position += 9 + length
    return found


def test_no_flipped_bit_is_taken_for_the_end_while_a_chunk_follows(killed):
    whole = killed.read_bytes()
    records = records_of(whole)
    last_chunk = max(start for start, kind, _ in records if kind == Opcode.CHUNK)
    # What has no checksum of its own: kinds, lengths and the indexes of the messages.
    bare = [
        byte
        for start, kind, length in records
        if start < last_chunk
        for byte in range(start, start + 9 + (length if kind == Opcode.MESSAGE_INDEX else 0))
    ]
    random_source = random.Random(6)
    for byte in random_source.sample(bare, 300):
        flipped = bytearray(whole)
        flipped[byte] ^= 1 << random_source.randrange(8)
        killed.write_bytes(flipped)
        with contextlib.suppress(*DAMAGE):
            assert scan(killed, Content().take).end >= last_chunk


def test_a_length_that_is_damaged_in_the_middle_is_not_taken_for_the_end(killed, campaign, step_of):
    whole = killed.read_bytes()
    chunks = [start for start, kind, _ in records_of(whole) if kind == Opcode.CHUNK]
    for chunk in (chunks[0], chunks[3]):
        damaged = bytearray(whole)
        damaged[chunk + 4] ^= 0x40
        killed.write_bytes(damaged)
        again = Archive(killed.parent, least_free_bytes=0)
        again.recover()
        with pytest.raises(RefusedError, match="others follow it"):
            again.commit("demo", step_of(12, campaign.planned("demo.i12")))
        assert killed.read_bytes() == damaged
