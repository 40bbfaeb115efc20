"""Hash of a model's content, which is its id and proves that a stored model is complete."""

from __future__ import annotations

import hashlib

from duralab_proto.v1 import identifier_pb2


def content_hash(message: identifier_pb2.Model) -> str:
    """Return the SHA-256 of a model's content without its id.

    Parameters
    ----------
    message : Model
        Model, which is not changed.

    Returns
    -------
    str
        64 hexadecimal digits, of the message serialised in the order of its field numbers, without the id.
    """
    bare = identifier_pb2.Model()
    bare.CopyFrom(message)
    bare.ClearField("id")
    return hashlib.sha256(bare.SerializeToString(deterministic=True)).hexdigest()
