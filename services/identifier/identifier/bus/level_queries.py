"""Series of one experiment at several levels: the levels, their order and their run names."""

import numpy as np

from duralab_proto.arrays import ArrayError, from_array, to_array
from duralab_proto.v1 import identifier_pb2
from duralab_settings import SettingsError

FEWEST_LEVELS, MOST_LEVELS = 2, 8
"""Smallest and largest number of levels in a series."""


def level_series(request: identifier_pb2.LevelsRequest) -> tuple[identifier_pb2.IdentifyRequest, ...]:
    """Split a series into its experiments, from the lowest level to the highest.

    `request`: As received, untrusted.
    Returns: One for each level, with the seeds of the first and separate runs: <run>.l1, <run>.l2, ...
    Raises `SettingsError`: The factors are not allowed or the experiment has no levels.
    """
    try:
        factors = from_array(request.factors, field="factors", shape=(None,), dtype=np.float64)
    except ArrayError as error:
        raise SettingsError(str(error), field=error.field) from error
    ordered = np.sort(factors)
    if not FEWEST_LEVELS <= factors.size <= MOST_LEVELS or ordered[0] <= 0.0 or np.any(np.diff(ordered) == 0.0):
        raise SettingsError(
            f"The factors are {factors.tolist()}; give {FEWEST_LEVELS} to {MOST_LEVELS} different ones greater than 0.",
            field="factors",
        )
    series = []
    for number, factor in enumerate(ordered, start=1):
        one = identifier_pb2.IdentifyRequest()
        one.CopyFrom(request.identify)
        one.run = f"{request.identify.run}.l{number}"
        name = "peak" if one.excitation.HasField("peak") else "rms"
        try:
            levels = from_array(getattr(one.excitation, name), field=f"excitation.{name}", dtype=np.float64)
        except ArrayError as error:
            raise SettingsError(str(error), field=error.field) from error
        getattr(one.excitation, name).CopyFrom(to_array(levels * factor))
        series.append(one)
    return tuple(series)
