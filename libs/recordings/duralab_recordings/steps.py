"""Responses as they were judged, from the steps of every format version."""

from __future__ import annotations

import numpy as np

from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2


def response_in_band(
    step: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep, target: np.ndarray
) -> np.ndarray:
    """Return the response of a playback in the control band, divided by the playback's level.

    Parameters
    ----------
    step : IterationStep or ConfirmationStep
        Of the playback.
    target : ndarray, shape (responses, samples)
        In the control band.

    Returns
    -------
    ndarray, shape (responses, samples)
        float64, in the units of the responses.

    Raises
    ------
    ArrayError
        The step's array is damaged, or of another shape than the target.
    """
    if step.HasField("error_in_band"):
        return target - from_array(step.error_in_band, field="error_in_band", shape=target.shape, dtype=np.float32)
    found = from_array(step.response_in_band, field="response_in_band", shape=target.shape, dtype=np.float64)
    # A copy: as a view it would hold the whole message.
    return found.copy()
