"""Trust in an identified model: random error, nonlinearity, prediction, convergence, levels."""

from identifier.uncertainty.convergence import Convergence, predict_convergence, spectral_radius
from identifier.uncertainty.covariance import element_variance, relative_magnitude_variance, row_covariance
from identifier.uncertainty.differences import ModelDifference, difference_sentences, model_difference
from identifier.uncertainty.distortion import DistortionLevels, can_separate, has_other_phases, separate_distortion
from identifier.uncertainty.level_advice import CREST_FACTOR, LevelAdvice, advise_levels, damage_at_levels
from identifier.uncertainty.level_check import LevelCheck, check_level, level_sentence
from identifier.uncertainty.prediction import Prediction, predict_response
from identifier.uncertainty.valid_band import ValidBand
from identifier.uncertainty.verdict import (
    Shares,
    distortion_shares,
    noise_shares,
    separated_verdicts,
    unexplained_shares,
    unexplained_verdicts,
    unknown_verdicts,
)

__all__ = [
    "CREST_FACTOR",
    "Convergence",
    "DistortionLevels",
    "LevelAdvice",
    "LevelCheck",
    "ModelDifference",
    "Prediction",
    "Shares",
    "ValidBand",
    "advise_levels",
    "can_separate",
    "check_level",
    "damage_at_levels",
    "difference_sentences",
    "distortion_shares",
    "element_variance",
    "has_other_phases",
    "level_sentence",
    "model_difference",
    "noise_shares",
    "predict_convergence",
    "predict_response",
    "relative_magnitude_variance",
    "row_covariance",
    "separate_distortion",
    "separated_verdicts",
    "spectral_radius",
    "unexplained_shares",
    "unexplained_verdicts",
    "unknown_verdicts",
]
