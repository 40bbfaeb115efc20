"""The compiled player: trace a model, generate straight-line code for it, integrate it.

A model is written once with operators and the functions of :mod:`rig_sim.compile.numeric`; it runs on plain floats to
be checked, and compiled to be played.
"""

from rig_sim.compile.code_cache import FOLDER_VARIABLE, cached_bytes, cached_model
from rig_sim.compile.compiled_model import CompiledModel, Playback, Run, Steps
from rig_sim.compile.integrate import Method, amplification
from rig_sim.compile.lane_model import WIDTHS, LaneModel, widest_lanes
from rig_sim.compile.many import Many, at_once, taken
from rig_sim.compile.model import compile_model, trace_model
from rig_sim.compile.numeric import (
    absolute,
    asin,
    atan2,
    clamp,
    cos,
    exp,
    inverse_sqrt,
    maximum,
    minimum,
    select_positive,
    sin,
    sqrt,
    tanh,
)
from rig_sim.compile.tracing import Graph, TracedModel
from rig_sim.compile.variants import Fingerprint, Variants, fingerprint, unite

__all__ = [
    "FOLDER_VARIABLE",
    "WIDTHS",
    "CompiledModel",
    "Fingerprint",
    "Graph",
    "LaneModel",
    "Many",
    "Method",
    "Playback",
    "Run",
    "Steps",
    "TracedModel",
    "Variants",
    "absolute",
    "amplification",
    "asin",
    "at_once",
    "atan2",
    "cached_bytes",
    "cached_model",
    "clamp",
    "compile_model",
    "cos",
    "exp",
    "fingerprint",
    "inverse_sqrt",
    "maximum",
    "minimum",
    "select_positive",
    "sin",
    "sqrt",
    "taken",
    "tanh",
    "trace_model",
    "unite",
    "widest_lanes",
]
