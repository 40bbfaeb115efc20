"""Drawings of the shipped rigs at rest, from the geometry in their SDF, into docs/rigs/<rig>_drawing.png.

`python studies/rig_drawing.py [RIG…]` draws them again: seen from behind, the right and above, to one scale. Struts
come from the specimen's YAML, for Drake has no word for them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from pydrake.geometry import Box, Cylinder, Role, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder
from scipy.spatial import ConvexHull

from rig_sim import Rig, load_rig, shipped_specimens
from rig_sim.specimen import mirrored_name

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

DOCS = Path(__file__).resolve().parents[1] / "docs" / "rigs"
RIGS = ("front_axle", "spindle_coupled_braking", "macpherson", "predecessor", "full_vehicle")
#: What a body is by a word in its name, first match first.
KINDS = (
    ("strut", "strut", "#c0562a"),
    ("piston", "piston and rod", "#d9a441"),
    ("tie", "tie rod, rack", "#3d8b4f"),
    ("rod", "piston and rod", "#d9a441"),
    ("rack", "tie rod, rack", "#3d8b4f"),
    ("arm", "arm", "#1b5e9b"),
    ("knuckle", "knuckle", "#8c6bb1"),
    ("wheel", "wheel", "#6b6b6b"),
    ("brake", "brake", "#b03060"),
    ("", "body", "#bdbdbd"),
)
STRUT_RADIUS = 0.03
ROD_RADIUS = 0.008
_TURN = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


@dataclass(frozen=True)
class Solid:
    """One convex piece: the name of its body, and points (points, 3) in m, in the world, whose hull it is."""

    body: str
    points: np.ndarray


@dataclass(frozen=True)
class View:
    """Where one stands, the axes that lie in the picture, and its place in the figure."""

    title: str
    across: int
    up: int
    row: int
    column: int

    @property
    def depth(self) -> int:
        """The axis that points out of the picture."""
        return 3 - self.across - self.up

    def nearness(self, piece: Solid) -> float:
        """Return what grows toward who looks: from above down; from behind and from the right along the axis."""
        return float(piece.points[:, 2].max() if self.depth == 2 else -piece.points[:, self.depth].min())


#: x points forward, y to the left, z up; seen from behind the axle, y points to the left.
VIEWS = (
    View("from behind", across=1, up=2, row=0, column=0),
    View("from the right", across=0, up=2, row=0, column=1),
    View("from above", across=1, up=0, row=1, column=0),
)


def points_of(shape: object) -> np.ndarray:
    """Return points (points, 3) in m, in the shape's own axes, whose convex hull is the shape."""
    if isinstance(shape, Cylinder):
        return cylinder_points(shape.radius(), shape.length())
    if isinstance(shape, Box):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return corners * np.array(shape.size()) / 2.0
    if isinstance(shape, Sphere):
        slices = np.linspace(0.0, np.pi, 9)
        rings = [np.column_stack([np.sin(a) * _ring(1.0), np.full(len(_TURN), np.cos(a))]) for a in slices]
        return shape.radius() * np.vstack(rings)
    raise TypeError(f"A {type(shape).__name__} cannot be drawn; use cylinders, boxes and spheres.")


def cylinder_points(radius: float, length: float) -> np.ndarray:
    """Return the rims (points, 3) in m of a cylinder along z."""
    return np.vstack([np.column_stack([_ring(radius), np.full(len(_TURN), end * length / 2)]) for end in (-1, 1)])


def _ring(radius: float) -> np.ndarray:
    return radius * np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def solids(rig: Rig, sdf: Path) -> list[Solid]:
    """Return every visual of the SDF and every strut of the YAML where they are when the rig rests."""
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(sdf)
    plant.Finalize()
    design, rest = plant.CreateDefaultContext(), plant.CreateDefaultContext()
    plant.SetPositions(rest, rig.rest[: plant.num_positions()])
    inspector = scene.model_inspector()
    found: list[Solid] = []
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        pose = plant.EvalBodyPoseInWorld(rest, body) @ inspector.GetPoseInFrame(geometry)
        found.append(Solid(body.name(), moved(pose, points_of(inspector.GetShape(geometry)))))
    tree = rig.model.assembly.tree
    for spring in tree.springs:
        a, b = (
            plant.EvalBodyPoseInWorld(rest, plant.GetBodyByName(tree.bodies[body].name)) @ point
            for body, point in ((spring.body_a, spring.point_a), (spring.body_b, spring.point_b))
        )
        found.append(Solid(spring.name, tube(a, b, radius=ROD_RADIUS)))
    for strut in rig.specimen.struts:
        ends = [(strut.body_a, strut.point_a), (strut.body_b, strut.point_b)]
        found.append(strut_solid(strut.name, plant, design, rest, ends))
        if strut.mirrored:
            others = [(mirrored_name(body), (p[0], -p[1], p[2])) for body, p in ends]
            found.append(strut_solid(mirrored_name(strut.name), plant, design, rest, others))
    return found


def strut_solid(
    name: str, plant: MultibodyPlant, design: Context, rest: Context, ends: Sequence[tuple[str, Sequence[float]]]
) -> Solid:
    """Return a tube between two points that are given where the model was designed."""
    a, b = (
        plant.EvalBodyPoseInWorld(rest, plant.GetBodyByName(body))
        @ plant.EvalBodyPoseInWorld(design, plant.GetBodyByName(body)).inverse()
        @ np.array(point)
        for body, point in ends
    )
    return Solid(name, tube(a, b, radius=STRUT_RADIUS))


def tube(a: Any, b: Any, *, radius: float) -> np.ndarray:
    """Return the rims (points, 3) in m of a cylinder between two points (3,) in the world."""
    length = float(np.linalg.norm(b - a))
    along = RotationMatrix.MakeFromOneVector((b - a) / length, axis_index=2)
    return moved(RigidTransform(along, (a + b) / 2), cylinder_points(radius, length))


def moved(pose: RigidTransform, points: np.ndarray) -> np.ndarray:
    """Return points (points, 3) in the world."""
    return (pose @ points.T).T


def kind_of(body: str) -> tuple[str, str]:
    """Return what a body is and its colour."""
    return next((text, colour) for word, text, colour in KINDS if word in body)


def draw(pieces: list[Solid]) -> Figure:
    """Draw three views to one scale, what is nearer over what is farther."""
    everything = np.vstack([piece.points for piece in pieces])
    low, high = everything.min(axis=0) - 0.05, everything.max(axis=0) + 0.05
    x, y, z = high - low
    figure = plt.figure(figsize=(9.0, 9.0 * (z + x) / (x + y) + 1.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(y, x), height_ratios=(z, x))
    for view in VIEWS:
        axes = figure.add_subplot(grid[view.row, view.column])
        for piece in sorted(pieces, key=view.nearness):
            flat = piece.points[:, [view.across, view.up]]
            outline = flat[ConvexHull(flat).vertices]
            _, colour = kind_of(piece.body)
            axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="0.2", lw=0.5, alpha=0.8))
        axes.set(xlim=(low[view.across], high[view.across]), ylim=(low[view.up], high[view.up]), aspect="equal")
        if view.across == 1:
            axes.invert_xaxis()  # y points to the left
        axes.set_title(view.title, fontsize=9)
        axes.set_xlabel(f"{'xyz'[view.across]}, m", fontsize=8)
        axes.set_ylabel(f"{'xyz'[view.up]}, m", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="x", nbins=4)
        axes.set_axisbelow(True)
        axes.grid(visible=True, color="0.93")
    patches = [Patch(facecolor=colour, label=text) for text, colour in sorted({kind_of(p.body) for p in pieces})]
    legend = figure.add_subplot(grid[1, 1])
    legend.axis("off")
    legend.legend(handles=patches, loc="center", fontsize=8, frameon=False)
    return figure


def main() -> None:
    """Draw all rigs, or those named."""
    for name in sys.argv[1:] or RIGS:
        path = shipped_specimens()[name]
        rig = load_rig(path)
        figure = draw(solids(rig, path.parent / rig.specimen.sdf))
        figure.savefig(DOCS / f"{name}_drawing.png", dpi=100, metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
