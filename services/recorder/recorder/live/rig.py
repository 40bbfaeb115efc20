"""Drawing of the rig in the live view: solids and lines that move with the poses of its bodies."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import rerun as rr

from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2
from recorder.live.pieces import Piece
from recorder.live.scene import Outline, Placed, Scene, line_ends, outline_of, solid_poses, with_world
from recorder.live.series import RUN_TIME, Colour

RIG: Final = "rig"
"""Path of the rig in the viewer's tree, as in the newest playback at the shown time."""

RIG_NOW: Final = "rig_now"
"""Path of the rig as it is now, independent of the shown time."""

ROLE_COLOURS: Final[dict[int, Colour]] = {
    rig_pb2.SHAPE_ROLE_SPECIMEN: (110, 160, 215),
    rig_pb2.SHAPE_ROLE_WHEEL: (96, 98, 104),
    rig_pb2.SHAPE_ROLE_PISTON: (240, 190, 80),
    rig_pb2.SHAPE_ROLE_CYLINDER: (150, 152, 158),
}
LINE_COLOURS: Final[dict[int, Colour]] = {
    rig_pb2.LINK_KIND_ACTUATOR: (240, 190, 80),
    rig_pb2.LINK_KIND_STRUT: (225, 87, 60),
    rig_pb2.LINK_KIND_ROD: (118, 183, 118),
    rig_pb2.LINK_KIND_ANTI_ROLL_BAR: (176, 122, 190),
}
_OTHER: Final[Colour] = (190, 190, 190)
# Half of the width, in m: a strut is a spring around a damper, the others are rods.
_LINE_RADII: Final[dict[int, float]] = {
    rig_pb2.LINK_KIND_ACTUATOR: 0.012,
    rig_pb2.LINK_KIND_STRUT: 0.03,
    rig_pb2.LINK_KIND_ROD: 0.008,
    rig_pb2.LINK_KIND_ANTI_ROLL_BAR: 0.01,
}
_ROD_RADIUS: Final = 0.008


class RigDrawing:
    """Draws one rig into a stream of the viewer.

    `stream`: Stream to draw into. `scene`: Shapes of the rig. `now`: Whether a viewer is connected: then the rig is
    also drawn as it is now.
    """

    def __init__(self, stream: rr.RecordingStream, scene: Scene, *, now: bool) -> None:
        self._stream = stream
        self._scene = scene
        self._now = now
        self._pending: Piece[tuple[np.ndarray, np.ndarray]] = Piece()
        solids = scene.solids
        self._boxes = [solid for solid in solids if isinstance(solid.solid, rig_pb2.BoxShape)]
        self._cylinders = [solid for solid in solids if isinstance(solid.solid, rig_pb2.CylinderShape)]
        self._spheres = [solid for solid in solids if isinstance(solid.solid, rig_pb2.SphereShape)]
        self._meshes = [solid for solid in solids if isinstance(solid.solid, rig_pb2.MeshShape)]
        for root in (RIG, RIG_NOW) if now else (RIG,):
            self._draw_forms(root)
        rest = scene.rest[None]
        self._move(rest, np.zeros(1))
        if now:
            self._place_now(rest)

    @property
    def outline(self) -> Outline:
        """Outline of the rig for the view's camera."""
        return outline_of(self._scene)

    def show(self, block: rig_pb2.PoseBlock, *, on_run_time: bool) -> None:
        """Move the rig; poses of playbacks are drawn in pieces of half a second, `catch_up` draws the waiting ones."""
        time = from_array(block.time, field="time", shape=(None,), dtype=np.float64)
        poses = from_array(block.poses, field="poses", shape=(len(time), self._scene.bodies, 7)).astype(float)
        if not len(time):
            return
        if on_run_time:
            last = self._pending.last
            if last is not None and time[0] <= last[1][-1]:
                # Poses of another playback replace those of this one.
                self.catch_up()
            self._pending.add((poses, time))
            if self._pending.due:
                self.catch_up()
        if self._now:
            self._place_now(poses[-1:])

    def catch_up(self) -> None:
        """Draw the waiting poses together."""
        if pending := self._pending.take():
            self._move(np.concatenate([poses for poses, _ in pending]), np.concatenate([time for _, time in pending]))

    def _draw_forms(self, root: str) -> None:
        """Send the constant parts: sizes, colours and names."""
        log = self._stream.log
        log(root, rr.ViewCoordinates.FLU, static=True)
        if self._boxes:
            sizes = [
                (s.solid.x / 2, s.solid.y / 2, s.solid.z / 2)
                for s in self._boxes
                if isinstance(s.solid, rig_pb2.BoxShape)
            ]
            log(f"{root}/boxes", rr.Boxes3D(half_sizes=sizes, fill_mode="solid", **_looks(self._boxes)), static=True)
        for name, cylinders in self._cylinders_by_fill():
            forms = [s.solid for s in cylinders if isinstance(s.solid, rig_pb2.CylinderShape)]
            fill = "solid" if name == "cylinders" else "majorwireframe"
            form = rr.Cylinders3D(
                lengths=[form.length for form in forms],
                radii=[form.radius for form in forms],
                fill_mode=fill,
                **_looks(cylinders),
            )
            log(f"{root}/{name}", form, static=True)
        if self._spheres:
            radii = [s.solid.radius for s in self._spheres if isinstance(s.solid, rig_pb2.SphereShape)]
            form = rr.Ellipsoids3D(radii=radii, fill_mode="solid", **_looks(self._spheres))
            log(f"{root}/spheres", form, static=True)
        for index, placed in enumerate(self._meshes):
            mesh = placed.solid
            if not isinstance(mesh, rig_pb2.MeshShape):
                continue
            form = rr.Mesh3D(
                vertex_positions=from_array(mesh.vertices, field="vertices"),
                triangle_indices=np.array(mesh.corners, dtype=np.uint32).reshape(-1, 3),
                albedo_factor=ROLE_COLOURS.get(placed.role, _OTHER),
            )
            log(f"{root}/meshes/{index}", form, static=True)
        if self._scene.lines:
            form = rr.LineStrips3D.from_fields(
                colors=[LINE_COLOURS.get(line.kind, _OTHER) for line in self._scene.lines],
                radii=[_LINE_RADII.get(line.kind, _ROD_RADIUS) for line in self._scene.lines],
                labels=[line.name for line in self._scene.lines],
                show_labels=False,
            )
            log(f"{root}/lines", form, static=True)

    def _cylinders_by_fill(self) -> list[tuple[str, list[Placed]]]:
        # The cylinder around a piston is drawn as a wireframe, so that the piston is visible.
        around = [solid for solid in self._cylinders if solid.role == rig_pb2.SHAPE_ROLE_CYLINDER]
        filled = [solid for solid in self._cylinders if solid.role != rig_pb2.SHAPE_ROLE_CYLINDER]
        return [(name, solids) for name, solids in (("cylinders", filled), ("actuator_cylinders", around)) if solids]

    def _groups(self) -> list[tuple[str, list[Placed], type[rr.Boxes3D | rr.Cylinders3D | rr.Ellipsoids3D]]]:
        groups = [("boxes", self._boxes, rr.Boxes3D), ("spheres", self._spheres, rr.Ellipsoids3D)]
        groups += [(name, solids, rr.Cylinders3D) for name, solids in self._cylinders_by_fill()]
        return [group for group in groups if group[1]]

    def _move(self, poses: np.ndarray, time: np.ndarray) -> None:
        """Move the rig to its poses at times of the newest playback."""
        every = with_world(poses)
        index = [rr.TimeColumn(RUN_TIME, duration=time)]
        for name, solids, kind in self._groups():
            centres, quaternions = solid_poses(every, solids)
            columns = kind.columns(centers=centres.reshape(-1, 3), quaternions=_last_first(quaternions).reshape(-1, 4))
            lengths = [len(solids)] * len(time)
            self._stream.send_columns(f"{RIG}/{name}", index, columns.partition(lengths))
        for number, placed in enumerate(self._meshes):
            centres, quaternions = solid_poses(every, [placed])
            columns = rr.Transform3D.columns(translation=centres[:, 0], quaternion=_last_first(quaternions)[:, 0])
            self._stream.send_columns(f"{RIG}/meshes/{number}", index, columns)
        if self._scene.lines:
            ends = line_ends(every, self._scene.lines)
            columns = rr.LineStrips3D.columns(strips=ends.reshape(-1, 2, 3))
            self._stream.send_columns(f"{RIG}/lines", index, columns.partition([len(self._scene.lines)] * len(time)))

    def _place_now(self, poses: np.ndarray) -> None:
        """Move the rig to its present pose; static data is shown at once, and the viewer keeps only the newest."""
        every = with_world(poses)
        for name, solids, kind in self._groups():
            centres, quaternions = solid_poses(every, solids)
            form = kind.from_fields(centers=centres[0], quaternions=_last_first(quaternions)[0])
            self._stream.log(f"{RIG_NOW}/{name}", form, static=True)
        for number, placed in enumerate(self._meshes):
            centres, quaternions = solid_poses(every, [placed])
            turn = rr.Quaternion(xyzw=_last_first(quaternions)[0, 0])
            self._stream.log(
                f"{RIG_NOW}/meshes/{number}", rr.Transform3D(translation=centres[0, 0], quaternion=turn), static=True
            )
        if self._scene.lines:
            form = rr.LineStrips3D.from_fields(strips=line_ends(every, self._scene.lines)[0])
            self._stream.log(f"{RIG_NOW}/lines", form, static=True)


def _looks(solids: list[Placed]) -> dict[str, Any]:
    return {
        "colors": [ROLE_COLOURS.get(solid.role, _OTHER) for solid in solids],
        "labels": [solid.name for solid in solids],
        "show_labels": False,
    }


def _last_first(quaternions: np.ndarray) -> np.ndarray:
    """Convert quaternions w, x, y, z to the viewer's order x, y, z, w."""
    return np.roll(quaternions, -1, axis=-1)
