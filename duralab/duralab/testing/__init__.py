"""Test support: a rig with an analytic response, an independent gateway, a temporary lab.

`duralab.testing.fixtures` provides pytest fixtures; pytest is not imported here.
"""

from duralab.testing.file_controller import ControllerFault, FileController
from duralab.testing.labs import FOREIGN_RIG, check_contract, file_gateway, foreign_gateway, lab
from duralab.testing.linear_rig import Filter, LinearRig

__all__ = [
    "FOREIGN_RIG",
    "ControllerFault",
    "FileController",
    "Filter",
    "LinearRig",
    "check_contract",
    "file_gateway",
    "foreign_gateway",
    "lab",
]
