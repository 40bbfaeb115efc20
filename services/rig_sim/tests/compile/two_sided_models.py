"""Models of two sides that mirror each other, alone, with a rack between them, and with a look across."""

from rig_sim.compile import (
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

#: Result of a side, from its state (x, y) and its constant.
OPERATIONS = {
    "add": lambda x, y, c: x + y * c,
    "subtract": lambda x, y, c: x * c - y,
    "multiply": lambda x, y, c: x * y * c,
    "divide": lambda x, y, c: x / (y + c),
    "negate": lambda x, y, c: -(x * c) - y,
    "abs": lambda x, y, c: absolute(x - c * y),
    "sqrt": lambda x, y, c: sqrt(x * x + c * c),
    "inverse_sqrt": lambda x, y, c: inverse_sqrt(x * x + c * c),
    "sin": lambda x, y, c: sin(c * x),
    "cos": lambda x, y, c: cos(c * x - y),
    "tanh": lambda x, y, c: tanh(c * x),
    "exp": lambda x, y, c: exp(c * x),
    "asin": lambda x, y, c: asin(c * 0.01 * x),
    "atan2": lambda x, y, c: atan2(c * x, y),
    "minimum": lambda x, y, c: minimum(c * x, y),
    "maximum": lambda x, y, c: maximum(x, c),
    "clamp": lambda x, y, c: clamp(x, -abs(c), y),
    "select_positive": lambda x, y, c: select_positive(c * x, y, 2.0 * x),
}
STATES = ["left x", "left y", "right x", "right y"]
INPUTS = ["left u", "right u"]


def two_sides(operation, constants):
    """Return a model of two sides that know nothing of each other; a polynomial makes the lanes worth their while."""

    def side(x, y, u, c):
        value = operation(x, y, c)
        heavy = value
        for power in range(6):
            heavy = heavy * (x + power + 0.5) + y * c
        return [value + 0.1 * heavy, u - c * x], value

    def model(state, inputs):
        left, first = side(state[0], state[1], inputs[0], constants[0])
        right, second = side(state[2], state[3], inputs[1], constants[1])
        return [*left, *right], [first, second]

    return model


def chain(state, inputs, *, coupling, mirror=-1.0):
    """Two chains of masses, one the mirror of the other, with a rack between them."""
    rates, outputs = [], []
    rack, rack_speed = state[0], state[1]
    pull = 0.0
    for side, sign in enumerate((1.0, mirror)):
        x, y, vx, vy = state[2 + 4 * side : 6 + 4 * side]
        stretch = x - sign * coupling * rack
        length = sqrt(1.0 + stretch * stretch + y * y)
        force = stretch * (40.0 + 5.0 * length) + 2.0 * vx / length
        rates += [vx, vy, -force + 3.0 * tanh(y) + inputs[side], -sign * 20.0 * y + sin(x) * vx - vy]
        pull = pull + sign * coupling * force
        outputs += [force * sign, length]
    return [rack_speed, pull - 8.0 * rack - rack_speed, *rates], [*outputs, rack, rack * rack_speed - pull]


CHAIN_STATES = ["rack", "rack speed", *(f"{side} {x}" for side in ("left", "right") for x in ("x", "y", "vx", "vy"))]


def looking_across(state, inputs):
    """Return two sides of which each reads what the other computes, with the sign that a mirror gives it."""
    (a, b), (c, d) = state[:2], state[2:]
    left, right = b - a * a * b, c * c * d - d  # the right one is the mirror of the left one, turned
    rates = []
    for (x, y), own, other, u in (((a, b), left, right, inputs[0]), ((c, d), -right, -left, inputs[1])):
        bend = sqrt(1.0 + own * own + x * x) * tanh(other * x) / (2.0 + other * other * y * y)
        rates += [bend * other - y, u - x * own + bend * bend * y]
    return rates, [left, right, left * right]
