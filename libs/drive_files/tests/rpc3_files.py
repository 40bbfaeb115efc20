"""RPC III files made from the public description, number by number: the oracle of the codec."""

from __future__ import annotations

import struct

FIRST = ("FORMAT", "NUM_HEADER_BLOCKS", "NUM_PARAMS")


def record(keyword, value):
    return keyword.encode("latin-1").ljust(32, b"\0") + str(value).encode("latin-1").ljust(96, b"\0")


def keywords(channels, **changes):
    """Return the records of a plain file with these `channels` (name, unit, scale), in the order of the description."""
    values = {
        "FORMAT": "BINARY_IEEE_LITTLE_END",
        "NUM_HEADER_BLOCKS": None,
        "NUM_PARAMS": None,
        "FILE_TYPE": "TIME_HISTORY",
        "TIME_TYPE": "RESPONSE",
        "DELTA_T": "4.000000E-03",
        "PTS_PER_FRAME": 256,
        "CHANNELS": len(channels),
        "PTS_PER_GROUP": 2048,
        "FRAMES": 8,
        "HALF_FRAMES": 0,
        "REPEATS": 1,
    }
    for number, (name, unit, scale) in enumerate(channels, start=1):
        values[f"DESC.CHAN_{number}"] = name
        values[f"UNITS.CHAN_{number}"] = unit
        values[f"SCALE.CHAN_{number}"] = scale
    values |= changes
    return {keyword: value for keyword, value in values.items() if value != "left out"}


def header(values, *, extra_blocks=0, upper=str):
    blocks = -(-len(values) // 4) + extra_blocks
    values = {"NUM_HEADER_BLOCKS": blocks, "NUM_PARAMS": len(values)} | {
        keyword: value for keyword, value in values.items() if value is not None
    }
    order = [*FIRST, *(keyword for keyword in values if keyword not in FIRST)]
    return b"".join(record(upper(keyword), values[keyword]) for keyword in order).ljust(512 * blocks, b"\0")


def data(stored, *, points_per_group, code):
    """Return the demultiplexed groups of `stored` (one list for each channel), the last padded with zeros."""
    pieces = []
    for start in range(0, len(stored[0]), points_per_group):
        for channel in stored:
            group = list(channel[start : start + points_per_group])
            group += [0] * (points_per_group - len(group))
            pieces.append(struct.pack(f"{code[0]}{points_per_group}{code[1]}", *group))
    return b"".join(pieces)
