"""Checks of the signal blocks that come over the bus, before they reach the log."""

from __future__ import annotations

import math

import numpy as np

from duralab_proto.arrays import ArrayError, from_array
from duralab_proto.v1 import rig_pb2


def check_block(block: rig_pb2.SignalBlock, *, run: str, description: rig_pb2.RigDescription | None) -> str:
    """Return what is wrong with a block in a sentence, or an empty string.

    Parameters
    ----------
    block : rig_pb2.SignalBlock
        What was received; nothing in it is trusted.
    run : str
        The run that its key names.
    description : rig_pb2.RigDescription or None
        The rig's, where it was committed: the block must have its channels and its rate.
    """
    if block.run != run:
        return f"The block of run {block.run!r} came on the key of run {run!r}."
    if not (math.isfinite(block.sample_rate) and block.sample_rate > 0):
        return f"The sample rate is {block.sample_rate} Hz; it must be greater than 0."
    drives = None if description is None else len(description.drives)
    responses = None if description is None else len(description.responses)
    if description is not None and block.sample_rate != description.sample_rate:
        return f"The sample rate is {block.sample_rate} Hz; the rig's is {description.sample_rate} Hz."
    try:
        drive = from_array(block.drive, field="drive", shape=(drives, None), dtype=np.float64)
        from_array(block.response, field="response", shape=(responses, drive.shape[1]), dtype=np.float64)
    except ArrayError as error:
        return str(error)
    return ""
