"""Excitations: PSDs, random noise, sweeps, multisines, decorrelation of several drives, and levels.

`design_experiment` makes the drive and the positions of its captures; `plan_experiment` returns duration and results
without making the drive.
"""

from identifier.excitation.crest_factor import crest_factors, minimise_crest_factor
from identifier.excitation.design import Experiment, design_experiment
from identifier.excitation.fades import linear_fades
from identifier.excitation.hadamard import hadamard_matrix, nearest_hadamard_order, sign_matrix
from identifier.excitation.levels import check_levels, largest_excess
from identifier.excitation.orthogonal import PhaseSet, dft_matrix, draw_phases
from identifier.excitation.plan import ExperimentPlan, plan_experiment, shortest_delay_seconds
from identifier.excitation.power_spectrum import power_density, white
from identifier.excitation.random_noise import pure_random
from identifier.excitation.schedule import AVERAGES_PER_DRIVE, averages_of, schedule_experiment
from identifier.excitation.settings import ExperimentSettings

__all__ = [
    "AVERAGES_PER_DRIVE",
    "Experiment",
    "ExperimentPlan",
    "ExperimentSettings",
    "PhaseSet",
    "averages_of",
    "check_levels",
    "crest_factors",
    "design_experiment",
    "dft_matrix",
    "draw_phases",
    "hadamard_matrix",
    "largest_excess",
    "linear_fades",
    "minimise_crest_factor",
    "nearest_hadamard_order",
    "plan_experiment",
    "power_density",
    "pure_random",
    "schedule_experiment",
    "shortest_delay_seconds",
    "sign_matrix",
    "white",
]
