"""Parameters of the shipped axles: hard points, masses, stiffnesses. Changes here change their SDFs.

`double_wishbone.py` makes the SDF of an axle from these parameters alone. Axes follow
ISO 8855: x forward, y left, z up; the origin is on the ground below the middle of the axle.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

Point = tuple[float, float, float]


@dataclass(frozen=True)
class HardPoints:
    """Points of the left side at design height, in metres."""

    wheel_centre: Point = (0.0, 0.770, 0.320)
    lower_ball: Point = (0.008, 0.715, 0.190)
    lower_front_bushing: Point = (0.030, 0.270, 0.196)
    lower_rear_bushing: Point = (-0.280, 0.300, 0.200)
    upper_ball: Point = (-0.015, 0.680, 0.520)
    upper_front_hinge: Point = (0.110, 0.300, 0.530)
    upper_rear_hinge: Point = (-0.150, 0.300, 0.540)
    tie_rod_inner: Point = (-0.130, 0.280, 0.232)
    tie_rod_outer: Point = (-0.125, 0.705, 0.225)


@dataclass(frozen=True)
class Masses:
    """Masses of one side, in kilograms, and of the body on this axle."""

    lower_arm: float = 6.0
    upper_arm: float = 2.5
    knuckle: float = 18.0
    wheel: float = 22.0
    body: float = 700.0
    #: Roll inertia of the body about its centre, kg*m^2.
    body_roll_inertia: float = 300.0


@dataclass(frozen=True)
class Stiffnesses:
    """Linear bushings: stiffness in N/m and damping in N*s/m along x, y, z; rotation in N*m/rad and N*m*s/rad."""

    # As usual, a stiff handling bushing in line with the wheel and a soft ride bushing behind it.
    lower_front: Point = (1.2e6, 2.5e6, 2.5e6)
    lower_rear: Point = (4.0e5, 9.0e5, 6.0e5)
    upper_ball: Point = (8.0e5, 2.0e6, 6.0e6)
    #: Loss of rubber near 20 Hz and of a ball joint: damping = loss_time * stiffness.
    loss_time: float = 1.0e-3
    ball_loss_time: float = 2.5e-4
    rotation: Point = (60.0, 60.0, 60.0)
    rotation_damping: Point = (0.4, 0.4, 0.4)
    tie_rod: float = 1.2e7
    tie_rod_damping: float = 4.0e3
    actuator_rod: float = 3.0e7
    actuator_rod_damping: float = 4.0e3


@dataclass(frozen=True)
class ActuatorMount:
    """Actuator of a side: joint of its rod with the wheel, rod, and the piston's mass."""

    direction: str
    offset: Point
    rod: Point
    piston_mass: float


# Every rod's line of action goes through the wheel centre: no moment about the spindle at design height.
ACTUATORS = (
    ActuatorMount("vertical", (0.0, 0.0, -0.16), (0.0, 0.0, -1.0), 20.0),
    ActuatorMount("lateral", (0.0, 0.10, 0.0), (0.0, 1.0, 0.0), 10.0),
    ActuatorMount("longitudinal", (-0.12, 0.0, 0.0), (-1.0, 0.0, 0.0), 10.0),
)

# A brake makes a moment about the spindle: a level rod pushes at an arm of 0.28 m below the wheel's centre.
BRAKE = ActuatorMount("brake", (-0.05, 0.0, -0.28), (-1.0, 0.0, 0.0), 10.0)


@dataclass(frozen=True)
class Rack:
    """Steering rack held at its pinion: effective mass, stiffness and damping of pinion and column."""

    #: Mass of rack, inner joints and the pinion's inertia reduced to the rack, in kg.
    mass: float = 5.0
    #: Stiffness in N/m and damping in N*s/m along the rack.
    stiffness: float = 1.0e7
    damping: float = 4.0e3


@dataclass(frozen=True)
class Axle:
    """Parameters of the SDF of an axle."""

    name: str
    body_held: bool
    points: HardPoints = field(default_factory=HardPoints)
    masses: Masses = field(default_factory=Masses)
    stiffnesses: Stiffnesses = field(default_factory=Stiffnesses)
    actuators: tuple[ActuatorMount, ...] = ()
    #: For a vehicle's second axle: prefix of its names, and distance behind the origin, in m.
    prefix: str = ""
    behind: float = 0.0
    #: Without a rack the tie rods end on the body.
    rack: Rack | None = None


FRONT_AXLE = Axle(name="front_axle", body_held=True, actuators=ACTUATORS, rack=Rack())
SPINDLE_COUPLED_BRAKING = replace(FRONT_AXLE, name="spindle_coupled_braking", actuators=(*ACTUATORS, BRAKE))
PREDECESSOR = Axle(
    name="predecessor",
    body_held=False,
    points=replace(
        HardPoints(),
        wheel_centre=(0.0, 0.755, 0.310),
        lower_ball=(0.012, 0.700, 0.185),
        upper_ball=(-0.010, 0.668, 0.490),
        upper_front_hinge=(0.105, 0.310, 0.500),
        upper_rear_hinge=(-0.140, 0.310, 0.508),
        tie_rod_outer=(-0.120, 0.690, 0.220),
    ),
    masses=Masses(lower_arm=5.2, upper_arm=2.2, knuckle=15.5, wheel=19.0, body=640.0, body_roll_inertia=260.0),
    stiffnesses=replace(
        Stiffnesses(),
        lower_front=(1.0e6, 2.2e6, 2.2e6),
        lower_rear=(3.2e5, 8.0e5, 5.0e5),
        upper_ball=(6.5e5, 1.8e6, 5.0e6),
    ),
)
DOUBLE_WISHBONES = (FRONT_AXLE, SPINDLE_COUPLED_BRAKING, PREDECESSOR)


@dataclass(frozen=True)
class MacPhersonPoints:
    """Points of the left side of a MacPherson axle at design height, in metres; the strut's axis leans inward."""

    wheel_centre: Point = (0.0, 0.755, 0.305)
    lower_ball: Point = (0.000, 0.690, 0.175)
    lower_front_bushing: Point = (0.010, 0.330, 0.190)
    lower_rear_bushing: Point = (-0.300, 0.345, 0.195)
    #: Point where the spring's force enters the tube, and end of the rod in the body, both on the strut's axis.
    strut_foot: Point = (-0.004, 0.610, 0.420)
    top_mount: Point = (-0.030, 0.545, 0.860)
    tie_rod_inner: Point = (-0.140, 0.340, 0.245)
    tie_rod_outer: Point = (-0.135, 0.690, 0.235)


@dataclass(frozen=True)
class MacPhersonAxle:
    """Parameters of the SDF of a MacPherson axle; masses in kilograms."""

    name: str
    points: MacPhersonPoints = field(default_factory=MacPhersonPoints)
    lower_arm_mass: float = 5.0
    #: Knuckle, hub, brake and strut tube.
    knuckle_mass: float = 19.0
    #: Rod and damper piston, with the share of the spring that moves with them.
    rod_mass: float = 3.0
    wheel_mass: float = 20.0
    body_mass: float = 620.0
    body_roll_inertia: float = 260.0
    stiffnesses: Stiffnesses = field(default_factory=Stiffnesses)
    #: Rubber of the top mount along x, y, z, in N/m.
    top_mount: Point = (2.5e6, 2.5e6, 1.2e6)
    actuators: tuple[ActuatorMount, ...] = ACTUATORS


MACPHERSON = MacPhersonAxle(name="macpherson", stiffnesses=replace(Stiffnesses(), lower_front=(1.5e6, 4.0e6, 2.5e6)))
