"""Write the SDF of a whole car on four double wishbones: the predecessor's front axle, a rear axle, one body.

`python scripts/specimens/full_vehicle.py` writes the shipped one again. The body heaves, pitches and rolls about its
centre of mass, which is held above one place of the road: the car drives straight ahead at the speed of its drives,
and the constraint carries lateral and longitudinal forces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from axles import PREDECESSOR, Axle, Stiffnesses
from double_wishbone import add_side
from sdf_writing import add_joint, add_link, new_sdf, sdf_text, write_shipped

WHEELBASE = 2.8


@dataclass(frozen=True)
class VehicleBody:
    """The sprung body of an upper-class passenger car with two people: radii of gyration 0.60, 1.25 and 1.30 m."""

    mass: float = 1300.0
    #: 52 % of the weight on the front axle; the height is usual for a saloon.
    centre: tuple[float, float, float] = (-0.48 * WHEELBASE, 0.0, 0.55)
    #: About x, y, z through the centre, in kg*m^2.
    inertia: tuple[float, float, float] = (470.0, 2030.0, 2200.0)


# The predecessor's front links turned into rear ones: arms that trail less, a toe link behind the wheel in place
# of the steered tie rod, a narrower upper arm, and bushings soft along x for comfort, stiff across for toe.
REAR_AXLE = Axle(
    name="rear_axle",
    body_held=False,
    prefix="rear_",
    behind=WHEELBASE,
    points=replace(
        PREDECESSOR.points,
        wheel_centre=(0.0, 0.760, 0.310),
        lower_ball=(0.005, 0.705, 0.188),
        lower_front_bushing=(0.180, 0.340, 0.205),
        lower_rear_bushing=(-0.090, 0.330, 0.200),
        upper_ball=(0.010, 0.672, 0.480),
        upper_front_hinge=(0.110, 0.360, 0.486),
        upper_rear_hinge=(-0.070, 0.360, 0.490),
        tie_rod_inner=(-0.200, 0.330, 0.225),
        tie_rod_outer=(-0.195, 0.695, 0.220),
    ),
    masses=replace(PREDECESSOR.masses, knuckle=14.0, lower_arm=5.5),
    stiffnesses=replace(
        Stiffnesses(),
        lower_front=(4.5e5, 1.2e6, 9.0e5),
        lower_rear=(7.0e5, 2.4e6, 2.0e6),
        upper_ball=(6.0e5, 1.6e6, 5.0e6),
    ),
)


def write_sdf(body: VehicleBody) -> str:
    """Return the SDF of the car as text, ending in a newline."""
    root, model = new_sdf("full_vehicle")
    centre, at_centre = np.array(body.centre), np.zeros(3)
    up, left, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    # Drake has no joint for heave, pitch and roll, so two light carriages between three joints are used.
    for name in ("heave_carriage", "pitch_carriage"):
        add_link(model, name, origin=centre, centre=centre, mass=5.0, inertia=np.eye(3))
    add_link(model, "body", origin=at_centre, centre=centre, mass=body.mass, inertia=np.diag(body.inertia))
    add_joint(model, "body_heave", "prismatic", parent="world", child="heave_carriage", axis=up)
    add_joint(model, "body_pitch", "revolute", parent="heave_carriage", child="pitch_carriage", axis=left)
    add_joint(model, "body_roll", "revolute", parent="pitch_carriage", child="body", offset=centre, axis=ahead)
    for axle in (PREDECESSOR, REAR_AXLE):
        for side in ("left", "right"):
            add_side(model, axle, side)
    return sdf_text(root, "full_vehicle")


def main() -> None:
    """Write the shipped SDF over the old one."""
    write_shipped("full_vehicle", write_sdf(VehicleBody()))


if __name__ == "__main__":
    main()
