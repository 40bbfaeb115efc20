"""Models of rigs: built from estimates, as values and as messages, named by the hash of their content, and cached."""

from identifier.modelling.building import distortion_of, model_of, plan_message, with_shape
from identifier.modelling.cache import ModelCache
from identifier.modelling.line_filling import FilledLines, fill_lines, valid_band
from identifier.modelling.mapped_estimate import learn_map
from identifier.modelling.model import IdentifiedModel, content_hash, from_message, to_message, with_id

__all__ = [
    "FilledLines",
    "IdentifiedModel",
    "ModelCache",
    "content_hash",
    "distortion_of",
    "fill_lines",
    "from_message",
    "learn_map",
    "model_of",
    "plan_message",
    "to_message",
    "valid_band",
    "with_id",
    "with_shape",
]
