"""A rolling tyre on an effective road: radial spring, tilted contact, lateral slip with a relaxation length.

The road enters already enveloped by the tyre (height, forward slope, lateral slope under the wheel). Force follows the
tilted contact plane; side force builds up over the relaxation length (Pacejka, *Tire and Vehicle Dynamics*, chapters 5
and 10). The slip angle is that of the wheel centre's path; the wheel's own steer angle (bump steer) and its spin are
left out: it rolls freely and transmits no drive or brake torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as parameters

from rig_sim.compile import maximum
from rig_sim.multibody import Array, Effect, ForceElement, Input, Motion, vector, wrench_at
from rig_sim.parameters import STRICT, NotNegative, Positive


@parameters(config=STRICT)
class TyreLaw:
    """Parameters of a tyre."""

    #: Radius without load, in m.
    free_radius: Positive
    #: Radial stiffness, in N/m, and damping, in N*s/m.
    radial_stiffness: Positive
    radial_damping: NotNegative
    #: Side force per slip angle, in N/rad, and the distance over which it builds up, in m.
    cornering_stiffness: Positive
    relaxation_length: Positive
    #: Load with half of the side force, in N: a tyre in the air has none, a loaded one nearly all.
    half_contact_load: Positive


@dataclass(frozen=True)
class Tyre(ForceElement):
    """A tyre under a wheel body whose centre is the body's origin.

    Inputs: height of the effective road under the wheel [m], its slope [1], positive uphill, its camber [1], positive
    when higher on the left, and the wheel's speed over it [m/s], forward. At rest the side force, in kN, keeps its
    value, as a standing tyre does.
    """

    name: str
    wheel: int
    law: TyreLaw
    inputs: tuple[Input, ...]

    initial_state = (0.0,)

    def apply(self, motion: Motion, state: Array, values: Array, effect: Effect) -> list[Any]:
        """Apply the forces of the road on the wheel."""
        law = self.law
        height, slope, camber, speed = values
        centre, velocity = motion.point(self.wheel, np.zeros(3))
        deflection = height + law.free_radius - centre[2]
        deflection_rate = speed * slope - velocity[2]
        load = maximum(law.radial_stiffness * deflection + law.radial_damping * deflection_rate, 0.0)
        side = 1.0e3 * state[0]
        force = vector(-load * slope, side - load * camber, load)
        contact = vector(centre[0], centre[1], height)
        effect.wrenches[self.wheel] = effect.wrenches[self.wheel] + wrench_at(contact, force)
        # Speed times the steady side force: in this form it is valid at standstill, where the slip angle is undefined.
        grip = law.cornering_stiffness * load / (load + law.half_contact_load)
        return [(-1.0e-3 * grip * velocity[1] - speed * state[0]) * (1.0 / law.relaxation_length)]
