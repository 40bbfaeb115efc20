"""Whether every actuator moves something: a piston that nothing is fixed to plays into the air."""

from __future__ import annotations

from collections.abc import Sequence

from rig_sim.multibody import Body, Joint, JointKind, MultibodyTree


def welded_groups(bodies: Sequence[Body], joints: Sequence[Joint]) -> list[set[int]]:
    """Return which bodies move as one, by index; the first group holds the world."""
    group_of = [{index} for index in range(len(bodies))]
    for joint in joints:
        if joint.kind is JointKind.WELD:
            merged = group_of[joint.parent] | group_of[joint.child]
            for index in merged:
                group_of[index] = merged
    return [group for index, group in enumerate(group_of) if index == min(group)]


def check_connected(tree: MultibodyTree, joint_name: str, *, actuator: str, mounted: Sequence[set[int]]) -> None:
    """Check that the body an actuator moves leads somewhere."""
    joint = tree.joint(joint_name)
    piston = next(group for group in welded_groups(tree.bodies, tree.joints) if joint.child in group)
    pairs = [{other.parent, other.child} for other in tree.joints if other.name != joint_name]
    pairs += [{spring.body_a, spring.body_b} for spring in tree.springs]
    pairs += [{bushing.body_a, bushing.body_c} for bushing in tree.bushings]
    if len(piston) == 1 and not any(pair & piston and pair - piston for pair in [*pairs, *mounted]):
        raise ValueError(
            f"actuator {actuator!r} moves {tree.bodies[joint.child].name!r}, to which nothing is connected; join it to "
            "the specimen by a joint, spring, bushing or strut."
        )
