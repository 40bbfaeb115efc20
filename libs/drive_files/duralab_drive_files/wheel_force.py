"""Signs of wheel-force transducers, and the reference point of their moments."""

from __future__ import annotations

from enum import StrEnum
from types import MappingProxyType
from typing import Final

import numpy as np

COMPONENTS: Final = ("fx", "fy", "fz", "mx", "my", "mz")
"""Forces and moments of a wheel, in this order."""


class WheelForceConvention(StrEnum):
    """Axes of a wheel-force transducer at the output of its interface."""

    ISO_8855 = "iso_8855"
    SWIFT_LEFT = "swift_left"
    SWIFT_RIGHT = "swift_right"


_TO_ISO: Final = MappingProxyType(
    {
        # x forward, y to the left, z up.
        WheelForceConvention.ISO_8855: (1, 1, 1, 1, 1, 1),
        # z up and y out of the vehicle, right-handed: on the left side that is ISO 8855.
        WheelForceConvention.SWIFT_LEFT: (1, 1, 1, 1, 1, 1),
        # On the right side y points to the right, so x points backwards.
        WheelForceConvention.SWIFT_RIGHT: (-1, -1, 1, -1, -1, 1),
    }
)


def wheel_force_signs(convention: WheelForceConvention) -> tuple[int, ...]:
    """Return the signs that convert a transducer's axes to those of ISO 8855.

    Parameters
    ----------
    convention : WheelForceConvention
        Axes of the transducer.

    Returns
    -------
    tuple of int
        1 or -1 for fx, fy, fz, mx, my and mz.

    Notes
    -----
    Source: MTS, SWIFT Mini TI manual 568062, page 49, standard setting of the polarities: z up, y out of the vehicle,
    moments by the right-hand rule, x forward on the left side and backward on the right. If the polarities in the
    calibration file were changed, map the six channels as responses with a sign of each.
    """
    return _TO_ISO[convention]


def moments_about(forces: np.ndarray, moments: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return moments about another point.

    Parameters
    ----------
    forces, moments : ndarray, shape (3, samples)
        Forces in N and moments in N m, the moments about the transducer's centre.
    offset : ndarray, shape (3,)
        Vector from the transducer's centre to the other point, in m.

    Returns
    -------
    ndarray, shape (3, samples)
        Moments in N m.
    """
    return moments - np.cross(offset, forces, axisb=0, axisc=0)
