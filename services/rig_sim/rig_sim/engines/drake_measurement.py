"""What Drake says of every response: reaction forces and moments, accelerations, distances, forces in bushings."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ForceElementIndex, LinearBushingRollPitchYaw
from pydrake.systems.framework import Context

from rig_sim.model import BushingForce, RigModel, Sensor, StrutTravel
from rig_sim.multibody import Array, move
from rig_sim.specimen import (
    AccelerationChannel,
    BushingChannel,
    Quantity,
    ResponseChannel,
    SpindleChannel,
    StrutChannel,
)


def drake_responses(model: RigModel, plant: MultibodyPlant, context: Context, state: Array) -> np.ndarray:
    """Read all responses from Drake.

    `model`: Says what is measured. `plant`: Finalised; the one whose tree the model has. `context`: Of the plant, at
    this state, with the forces of the YAML's elements on its input ports. `state`: Of the model. Of rubber beside a
    bushing, of which Drake knows nothing, the model says the force.
    Returns: In the model's order of responses, each in its unit.
    """
    readings = [
        _reading(channel, sensor, plant, context, own=(model, state))
        for channel, sensor in zip(model.assembly.specimen.responses, model.assembly.transducers, strict=True)
    ]
    return np.array(readings, dtype=float)


def _reading(
    channel: ResponseChannel, sensor: Sensor, plant: MultibodyPlant, context: Context, *, own: tuple[RigModel, Array]
) -> float:
    """Find what the YAML names in Drake's own plant, so that a sensor mounted wrongly is found out."""
    # pydrake's stubs take dtype parameters for shapes, so its arrays fit numpy's types nowhere.
    drake = cast(Any, plant)
    match channel:
        case SpindleChannel():
            index = int(plant.GetJointByName(channel.transducer).index())
            reaction = cast(Any, plant.get_reaction_forces_output_port().Eval(context))[index]
            # The port gives what acts on the child (the wheel), about the weld; the spindle feels the opposite.
            part = reaction.translational() if channel.quantity is Quantity.FORCE else reaction.rotational()
            return -float(part["xyz".index(channel.axis)])
        case AccelerationChannel():
            body = drake.GetBodyByName(channel.body)
            at_design = body.EvalPoseInWorld(plant.CreateDefaultContext())
            rotation = body.EvalPoseInWorld(context).rotation()
            spin = body.EvalSpatialVelocityInWorld(context).rotational()
            offset = rotation.multiply(at_design.inverse().multiply(np.array(channel.point)))
            at_point = body.EvalSpatialAccelerationInWorld(context).Shift(offset, spin).translational()
            return float(rotation.inverse().multiply(at_point)["xyz".index(channel.axis)])
        case StrutChannel():
            strut = cast(StrutTravel, sensor)
            ends = [
                drake.get_body(BodyIndex(body)).EvalPoseInWorld(context).multiply(point)
                for body, point in ((strut.body_a, strut.point_a), (strut.body_b, strut.point_b))
            ]
            return strut.design_length - float(np.linalg.norm(ends[1] - ends[0]))
        case BushingChannel():
            bushing = _drake_bushing(plant, channel.frame_a, channel.frame_c)
            row = "xyz".index(channel.axis)
            of_drake = bushing.CalcBushingSpatialForceOnFrameA(context).translational()
            return float(of_drake[row]) + _rubber_force(cast(BushingForce, sensor), *own)


def _drake_bushing(plant: MultibodyPlant, frame_a: str, frame_c: str) -> Any:
    for index in range(plant.num_force_elements()):
        element = plant.get_force_element(ForceElementIndex(index))
        if isinstance(element, LinearBushingRollPitchYaw):
            names = (element.frameA().name(), element.frameC().name())
            if names == (frame_a, frame_c):
                return element
    raise ValueError(f"the plant has no bushing from {frame_a!r} to {frame_c!r}.")


def _rubber_force(sensor: BushingForce, model: RigModel, state: Array) -> float:
    """Force of the rubber beside a bushing on its mount, in N, along the row of the sensor."""
    if not sensor.rubber:
        return 0.0
    tree, first = model.assembly.tree, model.position_count
    motion = move(tree, state[:first], state[first : first + tree.velocity_count])
    axes = motion.poses[sensor.bushing.body_a].rotation @ sensor.bushing.frame_a.rotation
    force = -sum(rubber.pull(motion, state[model.element_slice(rubber.name)]) for rubber in sensor.rubber)
    return float((axes.T @ cast(Any, force))[sensor.row])
