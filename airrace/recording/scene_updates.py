"""What a 3-D view shows of a race, as Foxglove's SceneUpdates."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from foxglove import messages as fg
from numpy.typing import ArrayLike

from airrace.recording.foxglove_messages import BODY, CAMERA, WORLD, pose, stamp, vector3
from airrace.rendering.scene.meshes import BOARD_THICKNESS
from airrace.systems.types import Detections
from airrace.track import (
    BOARD_SIZE,
    MARKER_SIZE,
    PYLON_BASE_RADIUS,
    PYLON_HEIGHT,
    PYLON_TIP_RADIUS,
    Course,
)
from airrace.track.gate_map import GateMap
from airrace.vehicle import Vehicle

if TYPE_CHECKING:
    from airrace.systems.planning.lap_plan import LapPlan


def color(r: float, g: float, b: float, a: float = 1.0) -> fg.Color:
    """Returns a colour of numbers from 0 to 1."""
    return fg.Color(r=r, g=g, b=b, a=a)


_PYLON, _WHITE, _BLACK = color(0.9, 0.35, 0.1), color(1, 1, 1), color(0.05, 0.05, 0.05)
_BODY, _ROTOR, _NOSE = color(0.25, 0.27, 0.3), color(0.3, 0.6, 0.9, 0.6), color(0.9, 0.3, 0.1)
_SIGMA, _RAY, _PLAN = color(0.2, 0.7, 1.0, 0.45), color(0.2, 0.9, 0.3, 0.8), color(0.1, 0.4, 1.0)
_OLD_PLAN = color(1.0, 0.55, 0.0, 0.5)  # orange, as in the report
_SIGMAS, _LEAST = 3.0, 0.05  # of an ellipsoid; m, less could not be seen


def _entity(time: float, name: str, frame: str = WORLD, **primitives: Any) -> fg.SceneEntity:
    return fg.SceneEntity(
        timestamp=stamp(time), frame_id=frame, id=name, frame_locked=frame == BODY, **primitives
    )


def _cylinder(
    position: Iterable[float], radius: float, height: float, color: fg.Color, top: float = 1.0
) -> fg.CylinderPrimitive:
    """Returns an upright one; top: its radius there, as a share of that at the bottom."""
    size = fg.Vector3(x=2 * radius, y=2 * radius, z=height)
    return fg.CylinderPrimitive(
        pose=pose(position), size=size, bottom_scale=1.0, top_scale=top, color=color
    )


def _text(position: Iterable[float], words: str, size: float) -> fg.TextPrimitive:
    return fg.TextPrimitive(
        pose=pose(position), billboard=True, font_size=size, color=_BLACK, text=words
    )


def _lines(kind: str, points: Iterable, thickness: float, **colors: Any) -> fg.LinePrimitive:
    """Returns lines through points, (n, 3): "LineStrip", or "LineList" of pairs of ends."""
    points = [fg.Point3(x=x, y=y, z=z) for x, y, z in np.asarray(points, float).tolist()]
    kind = getattr(fg.LinePrimitiveLineType, kind)
    return fg.LinePrimitive(type=kind, thickness=thickness, points=points, **colors)


def track_scene(time: float, track: Course, vehicle: Vehicle) -> fg.SceneUpdate:
    """Returns the gates, with boards where they have some, their numbers, and the drone."""
    tip = PYLON_TIP_RADIUS / PYLON_BASE_RADIUS
    pylons = [
        _cylinder(foot + [0, 0, PYLON_HEIGHT / 2], PYLON_BASE_RADIUS, PYLON_HEIGHT, _PYLON, tip)
        for foot in track.pylons()
    ]
    boards, texts = [], []
    for board in track.boards():
        turn = board.X_WM.rotation().ToQuaternion().wxyz()
        # The face is at z = 0 of the marker frame; the black square stands out a little.
        for size, z, paint in (
            (BOARD_SIZE, -BOARD_THICKNESS / 2, _WHITE),
            (MARKER_SIZE, -BOARD_THICKNESS / 2 + 0.005, _BLACK),
        ):
            boards.append(
                fg.CubePrimitive(
                    pose=pose(board.X_WM @ [0.0, 0.0, z], turn),
                    color=paint,
                    size=fg.Vector3(x=size, y=size, z=BOARD_THICKNESS),
                )
            )
        texts.append(_text(board.X_WM @ [0.0, 1.0, 0.3], str(board.id), 0.5))
    for gate in track.frames():
        for box in gate.boxes().values():
            turn, (x, y, z) = box.X_WB.rotation().ToQuaternion().wxyz(), box.size
            size = fg.Vector3(x=x, y=y, z=z)
            place = pose(box.X_WB.translation(), turn)
            boards.append(fg.CubePrimitive(pose=place, color=_PYLON, size=size))
    for n, gate in enumerate(track.gates):
        above = gate.p_WG + [0.0, 0.0, gate.height]
        texts.append(_text(above, f"gate {n + 1}", 2.0))
    gates = _entity(time, "gates", cylinders=pylons, cubes=boards, texts=texts)
    return fg.SceneUpdate(entities=[gates, _entity(time, "drone", BODY, **_drone(vehicle))])


def _drone(vehicle: Vehicle) -> dict:
    """Returns the primitives of a drone in its body frame: arms, discs, and its nose."""
    hubs = [rotor.position for rotor in vehicle.rotors]
    ends = [p for hub in hubs for p in ([0.0, 0.0, 0.0], hub)]
    arms = _lines("LineList", ends, 0.03, color=_BODY)
    discs = [_cylinder(rotor.position, rotor.radius, 0.01, _ROTOR) for rotor in vehicle.rotors]
    nose = fg.ArrowPrimitive(
        pose=pose([0.0, 0.0, 0.0]),
        shaft_length=0.2,
        shaft_diameter=0.03,
        head_length=0.1,
        head_diameter=0.08,
        color=_NOSE,
    )
    return dict(lines=[arms], cylinders=discs, arrows=[nose])


def map_scene(time: float, gate_map: GateMap) -> fg.SceneUpdate:
    """Returns the markers of a map as ellipsoids of three sigma, and its gates as lines."""
    spheres = [
        fg.SpherePrimitive(
            pose=pose(m.p_WM),
            color=_SIGMA,
            size=vector3(2 * np.maximum(_SIGMAS * np.sqrt(m.variance), _LEAST)),
        )
        for m in gate_map.markers
    ]
    ends = [[*foot, gate.p_WG[2]] for gate in gate_map.gates for foot in gate.pylons]
    lines = _lines("LineList", ends, 0.08, color=_SIGMA)
    texts = [_text(gate.p_WG, str(gate.number + 1), 1.0) for gate in gate_map.gates]
    return fg.SceneUpdate(
        entities=[_entity(time, "map", spheres=spheres, lines=[lines], texts=texts)]
    )


def plan_scene(time: float, plans: "Sequence[LapPlan]") -> fg.SceneUpdate:
    """Returns the plan in force, and those before it in orange.

    Args:
        time: (s).
        plans: LapPlans, the newest last.
    """
    entities = []
    for age, plan in enumerate(reversed(plans)):
        lines = [
            _lines(
                "LineStrip",
                part.positions(np.linspace(0.0, part.duration, 300)).T,
                0.05 if age else 0.12,
                color=_OLD_PLAN if age else _PLAN,
            )
            for part in (plan.entry, plan.circuit)
        ]
        entities.append(_entity(time, f"plan {age}", lines=lines))
    return fg.SceneUpdate(entities=entities)


def path_scene(
    time: float, positions: Iterable, speeds: ArrayLike, max_speed: float
) -> fg.SceneUpdate:
    """Returns a flown path, from blue where it was slow to red where it was fast.

    Args:
        time: (s).
        positions: rows of p_WB, (m). speeds: at them (m/s).
        max_speed: which is red (m/s).
    """
    shares = np.clip(np.asarray(speeds) / max_speed, 0.0, 1.0).tolist()
    colors = [color(s, 0.3 + 0.5 * min(s, 1 - s), 1 - s) for s in shares]
    line = _lines("LineStrip", positions, 0.15, colors=colors)
    return fg.SceneUpdate(entities=[_entity(time, "path", lines=[line])])


def detection_rays(detections: Detections) -> fg.SceneUpdate:
    """Returns lines from the camera to the markers that it sees."""
    ends = [
        p for marker in detections.markers for p in ([0.0, 0.0, 0.0], marker.X_CM.translation())
    ]
    rays = _lines("LineList", ends, 0.03, color=_RAY)
    return fg.SceneUpdate(entities=[_entity(detections.time, "rays", CAMERA, lines=[rays])])
