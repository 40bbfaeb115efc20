"""The answer to the query for a rig's FRF: what it is at the lines asked for, or that this rig does not know it."""

from __future__ import annotations

import numpy as np

from duralab_bus import FaultError
from duralab_gateway.rig import KnowsItsFrf
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import query_pb2, rig_pb2

#: Of one answer; each line of a 6 by 4 rig takes 384 bytes.
MOST_LINES = 200_000


def answer_frf(rig: object, description: rig_pb2.RigDescription, request: rig_pb2.RigFrfRequest) -> rig_pb2.RigFrf:
    """Answer the query.

    Parameters
    ----------
    rig : object
        The rig that is asked; it may know its FRF, see `KnowsItsFrf`.
    description : rig_pb2.RigDescription
        Of the rig.
    request : rig_pb2.RigFrfRequest
        Frequencies in Hz.

    Returns
    -------
    rig_pb2.RigFrf
        FRF at these frequencies, (frequencies, responses, drives).

    Raises
    ------
    FaultError
        UNIMPLEMENTED where the rig does not know its FRF, INVALID_ARGUMENT where a frequency is none of its own.
    """
    name, rate = description.rig, description.sample_rate
    if not isinstance(rig, KnowsItsFrf):
        raise FaultError(
            query_pb2.FAULT_CODE_UNIMPLEMENTED,
            f"{name} does not know its FRF: it is not linear; identify it with the identifier.",
        )
    frequency = from_array(request.frequency, field="frequency", shape=(None,), dtype=np.float64)
    wrong = f"{name} knows its FRF at frequencies from 0 to {rate / 2.0:g} Hz, at most {MOST_LINES} at once"
    if not 1 <= len(frequency) <= MOST_LINES:
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT, f"frequency has {len(frequency)} lines; {wrong}.", field="frequency"
        )
    beyond = ~((frequency >= 0.0) & (frequency <= rate / 2.0))
    if np.any(beyond):
        raise FaultError(
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            f"frequency holds {frequency[beyond][0]:g} Hz; {wrong}.",
            field="frequency",
        )
    frf = rig.sampled_frf(frequency)
    return rig_pb2.RigFrf(
        rig=name, frequency=to_array(frequency), frf=to_array(frf), content_hash=description.content_hash
    )
