"""Conversion of a learned drive map to a message of the contract, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from duralab_drive_map.drive_map import DriveMap
from duralab_drive_map.learning import LearnedDriveMap
from duralab_drive_map.map_terms import COEFFICIENTS, MapTerm
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, identifier_pb2

__all__ = ["from_message", "to_message"]


def to_message(learned: LearnedDriveMap[Any]) -> identifier_pb2.DriveMap:
    """Return a learned drive map as a message.

    Parameters
    ----------
    learned : LearnedDriveMap
        Learned map; the message has no terms if none were chosen.

    Returns
    -------
    identifier_pb2.DriveMap
        Message without names, units and sample rate, which the message that holds it states.
    """
    drive_map = learned.drive_map
    # If no term was chosen, the map is the previous one, which another message holds.
    sentences = drive_map.describe() if learned.chosen else ()
    return identifier_pb2.DriveMap(
        scale=to_array(np.array(drive_map.scale)),
        highest_frequency=drive_map.highest_frequency,
        terms=[
            identifier_pb2.DriveMapTerm(
                follower=chosen.term.follower,
                first=chosen.term.product[0],
                second=chosen.term.product[1],
                coefficients=to_array(np.array(chosen.term.coefficients)),
                standard_deviation=to_array(np.array(chosen.standard_deviation)),
                significance=chosen.significance,
                residual=chosen.residual,
                sentence=sentence,
            )
            for chosen, sentence in zip(learned.chosen, sentences, strict=True)
        ],
        remarks=learned.remarks,
    )


def from_message(
    message: identifier_pb2.DriveMap, *, drives: Sequence[array_pb2.Channel], sample_rate: float
) -> DriveMap:
    """Return the drive map that a message holds, checked.

    Parameters
    ----------
    message : identifier_pb2.DriveMap
        Message as received; nothing in it is trusted.
    drives : sequence of Channel
        Drives of the model that the map is for.
    sample_rate : float
        Sample rate of that model, Hz.

    Returns
    -------
    DriveMap
        Drive map; the identity if no term was chosen.

    Raises
    ------
    ArrayError
        If an array has a wrong shape or type.
    ValueError
        If a value is out of range, or the terms close a cycle.
    """
    scale = from_array(message.scale, field="drive_map.scale", shape=(len(drives),), dtype=np.float64)
    terms: list[MapTerm] = []
    for term in message.terms:
        found = from_array(
            term.coefficients, field="drive_map.terms.coefficients", shape=(COEFFICIENTS,), dtype=np.float64
        )
        terms.append(MapTerm(term.follower, (term.first, term.second), tuple(found.tolist())))
    return DriveMap(
        names=tuple(channel.name for channel in drives),
        units=tuple(channel.unit for channel in drives),
        scale=tuple(scale.tolist()),
        terms=tuple(terms),
        sample_rate=sample_rate,
        highest_frequency=message.highest_frequency,
    )
