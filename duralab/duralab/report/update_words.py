"""Description of the update as text."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_proto.v1 import array_pb2, iterator_pb2

_ALGORITHMS: Final = {
    iterator_pb2.UPDATE_KIND_BASIC_TWR: "basic Time Waveform Replication",
    iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING: "Adaptive Modelling",
    iterator_pb2.UPDATE_KIND_SECANT: "secant update",
}
_LIMITS: Final = {
    iterator_pb2.LIMIT_POLICY_PROJECT: "a near drive that holds it is played, and each change is reported",
    iterator_pb2.LIMIT_POLICY_REFUSE: "the campaign ends before the drive is played",
}


def iteration_in_words(specification: iterator_pb2.CampaignSpec) -> list[tuple[str, str]]:
    """Return the method of making drives, as terms and their values; default settings are omitted."""
    rows = [("Update", _update(specification.update, _names(specification)))]
    if specification.levels:
        rows.append(("Levels", f"{_listed(specification.levels)} of the target in the first playbacks, then all of it"))
    weight = _values(specification.update.weights)
    if weight.size:
        names = np.array(_names(specification))
        counted = weight > 0.0
        if not counted.all():
            rows.append(("Watched, not controlled", ", ".join(names[~counted])))
        if np.unique(weight[counted]).size > 1:
            rows.append(("Weights", _by_channel(list(names[counted]), weight[counted])))
    overrun = specification.largest_overrun
    projects = specification.limit_policy == iterator_pb2.LIMIT_POLICY_PROJECT
    refused = f"; a first drive beyond {overrun:g} × the limit is refused" if projects and overrun else ""
    rows.append(("At a limit of the rig", _LIMITS.get(specification.limit_policy, "not told") + refused))
    return rows


def _update(update: iterator_pb2.UpdateSettings, names: Sequence[str]) -> str:
    if update.HasField("plugin"):
        parts = [f"plug-in {update.plugin.name}", *_plugin_settings(update.plugin.settings)]
    else:
        parts = [_ALGORITHMS.get(update.kind, "unknown"), *_settings(update)]
    gain = _values(update.iteration_gain)
    parts.append(f"gain {gain[0]:g}" if np.unique(gain).size == 1 else f"gain of {_by_channel(names, gain)}")
    if update.gain_schedule:
        parts.append(f"times {_listed(update.gain_schedule)} for the first drive, the second and so on")
    curve = _values(update.gain_curve_frequency)
    if curve.size:
        parts.append(f"times a curve of {curve.size} points over {curve[0]:g} to {curve[-1]:g} Hz")
    if update.accept_segments:
        parts.append("each stretch from its best so far")
    return ", ".join(parts)


def _plugin_settings(text: str) -> list[str]:
    """Return names and values of a plug-in's settings; the text itself if it is not a JSON object."""
    try:
        return [f"{name} {value}" for name, value in json.loads(text or "{}").items()]
    except (ValueError, AttributeError):
        return [text]


def _settings(update: iterator_pb2.UpdateSettings) -> list[str]:
    if update.kind == iterator_pb2.UPDATE_KIND_ADAPTIVE_MODELLING:
        backward = update.prediction == iterator_pb2.CORRECTION_PREDICTION_BACKWARD
        full = update.correction == iterator_pb2.CORRECTION_SHAPE_FULL
        weighed = f", weighed by coherence above {update.lowest_coherence:g}" if update.weigh_by_coherence else ""
        return [
            f"{'backward' if backward else 'forward'} prediction",
            f"{'full' if full else 'diagonal'} correction of {update.smallest_correction:g} to "
            f"{update.largest_correction:g}{weighed}",
        ]
    if update.kind == iterator_pb2.UPDATE_KIND_SECANT and update.HasField("secant"):
        secant = update.secant
        return [
            f"forgetting {secant.forgetting:g}",
            f"prior strength {secant.prior_strength:g}",
            f"caution {secant.caution:g}",
            f"regularisation {secant.regularisation:g}",
            *(["odd terms"] if secant.odd_terms else []),
            *(["speeds of the drives"] if secant.speed_terms else []),
            *(["rate limits"] if secant.rate_limits else []),
            *(["lines of the whole record"] if secant.whole_record else []),
        ]
    return []


def _values(array: array_pb2.Array) -> NDArray[np.float64]:
    """Return an array of numbers, flat; empty if it is not set."""
    return np.frombuffer(array.data, dtype="<f8")


def _names(specification: iterator_pb2.CampaignSpec) -> list[str]:
    return [channel.name for channel in specification.target.channels]


def _by_channel(names: Sequence[str], values: NDArray[np.float64]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in zip(names, values, strict=True))


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
