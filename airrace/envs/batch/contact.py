"""What a drone touches: ground, pylons and boards, by the shapes that Drake's plant has of them.

A drone is the spheres of its SDF file. The distance to a pylon, a cone of 16 facets, is that to
the nearest plane of a facet; beside an edge, a sphere of 0.2 m is 4 mm nearer by that than it is.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import SceneGraph, Sphere
from pydrake.multibody.plant import MultibodyPlant

from airrace.common.errors import UserError
from airrace.common.jit import inlined
from airrace.envs.batch.courses import Courses
from airrace.math.triples import Triple, added, rotate, rotation_rows
from airrace.rendering.scene.meshes import BOARD_THICKNESS
from airrace.rendering.scene.pylon_shape import make_pylon_shape
from airrace.systems.plant.multirotor import AddMultirotorModel, ground_clearance
from airrace.track import BOARD_HEIGHT, BOARD_OFFSET, BOARD_SIZE
from airrace.vehicle import Vehicle
from airrace.vehicle.free_body import Motion

_SIDES = 16  # of a pylon, see AddScenery


def _pylon_planes():
    """Returns planes of a pylon in (outwards, up) as (normal, offset); its radius; its height."""
    vertices = make_pylon_shape(_SIDES, 1).vertices[::_SIDES]  # one of each ring
    middles = vertices[:, 0] * math.cos(math.pi / _SIDES)  # of its edges
    outline = list(zip(middles.tolist(), vertices[:, 2].tolist()))
    planes = []
    for (a, low), (b, high) in ((outline[0], outline[-2]), (outline[-2], outline[-1])):
        length = math.hypot(b - a, high - low)
        normal = ((high - low) / length, (a - b) / length)
        planes.append((*normal, normal[0] * a + normal[1] * low))
    return tuple(planes), float(vertices[0, 0]), float(vertices[-1, 2])


# Flank and tip, the greatest radius, and the height where the tip is cut off (m).
(_FLANK, _TIP), _REACH, _TOP = _pylon_planes()
_C1, _S1 = math.cos(math.pi / _SIDES), math.sin(math.pi / _SIDES)
_C3, _S3 = math.cos(3 * math.pi / _SIDES), math.sin(3 * math.pi / _SIDES)
_HALF_BOARD = BOARD_SIZE / 2
_HALF_THICKNESS = BOARD_THICKNESS / 2
# The horizontal distance from a pylon's axis within which it and its boards are (m).
_OBSTACLE_RADIUS = max(_REACH, math.hypot(BOARD_OFFSET, _HALF_BOARD))


class Shape(NamedTuple):
    """What of a drone can touch something."""

    spheres: np.ndarray  #: centres in B and radii, (s, 4) m
    reach: float  #: of the sphere around B's origin that holds all (m)
    standing_height: float  #: of B's origin over level ground that the drone stands on (m)


def load_shape(vehicle: Vehicle, sdf: Path, clearance: float = 0.0) -> Shape:
    """Returns the collision geometry of a drone.

    Args: clearance: by which the spheres are larger, but for a drone that stands (m).

    Raises:
        UserError: if the model cannot be used, or has other shapes than spheres.
    """
    plant, scene_graph = MultibodyPlant(0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    body = AddMultirotorModel(plant, vehicle, sdf)
    plant.Finalize()
    inspector, spheres = scene_graph.model_inspector(), []
    for geometry_id in plant.GetCollisionGeometriesForBody(body):
        shape = inspector.GetShape(geometry_id)
        if not isinstance(shape, Sphere):
            raise UserError(
                f"The collision geometry {inspector.GetName(geometry_id)} of {sdf} is no sphere; "
                "a batch of drones knows only those: describe the drone by spheres."
            )
        centre = inspector.GetPoseInFrame(geometry_id).translation()
        spheres.append([*centre, shape.radius()])
    table = np.array(spheres) + [0.0, 0.0, 0.0, clearance]
    reach = (np.linalg.norm(table[:, :3], axis=1) + table[:, 3]).max()
    return Shape(table, float(reach), ground_clearance(body, scene_graph))


@inlined
def is_near_something(position: Triple, margin: float, track: int, courses: Courses) -> bool:
    """Whether ground, a pylon or a board may be within a margin (m) of a position."""
    if position[2] < margin:
        return True
    near = (margin + _OBSTACLE_RADIUS) ** 2
    for k in range(courses.counts[track]):
        along, side = _from_gate(position, courses.gates[track, k])
        beside = abs(side) - courses.gates[track, k, 9]
        if along * along + beside * beside < near:
            return True
    return False


@inlined
def touches_ground(motion: Motion, shape: Shape) -> bool:
    """Whether some part of the drone is in the ground, which is at z = 0."""
    R_WB = rotation_rows(motion.quaternion)
    for s in range(len(shape.spheres)):
        centre = (shape.spheres[s, 0], shape.spheres[s, 1], shape.spheres[s, 2])
        if added(motion.position, 1.0, rotate(R_WB, centre))[2] < shape.spheres[s, 3]:
            return True
    return False


@inlined
def touches_gate(motion: Motion, shape: Shape, track: int, courses: Courses) -> bool:
    """Whether some part of the drone is in a pylon or a board."""
    near = (shape.reach + _OBSTACLE_RADIUS) ** 2
    R_WB = rotation_rows(motion.quaternion)
    for k in range(courses.counts[track]):
        gate = courses.gates[track, k]
        along, side = _from_gate(motion.position, gate)
        beside = abs(side) - gate[9]
        if along * along + beside * beside >= near:
            continue
        for s in range(len(shape.spheres)):
            p_BS = (shape.spheres[s, 0], shape.spheres[s, 1], shape.spheres[s, 2])
            p_WS = added(motion.position, 1.0, rotate(R_WB, p_BS))
            if _distance(p_WS, gate) < shape.spheres[s, 3]:
                return True
    return False


@inlined
def _from_gate(position, gate):
    """Returns where a position is, horizontally: forward of the gate's midpoint and right of it."""
    x, y = position[0] - gate[0], position[1] - gate[1]
    return x * gate[3] + y * gate[4], x * gate[6] + y * gate[7]


@inlined
def _distance(p_WS, gate):
    """Returns a position's distance from the nearer pylon of a gate, or its boards (m), see above.

    In a board it is zero, in a pylon negative.
    """
    along, side = _from_gate(p_WS, gate)
    dx = max(abs(abs(along) - (BOARD_OFFSET - _HALF_THICKNESS)) - _HALF_THICKNESS, 0.0)
    dy = max(abs(abs(side) - gate[9]) - _HALF_BOARD, 0.0)
    dz = max(abs(p_WS[2] - BOARD_HEIGHT) - _HALF_BOARD, 0.0)
    hand = math.copysign(1.0, side)  # of the pylon on this side
    x = abs(p_WS[0] - gate[0] - hand * gate[9] * gate[6])
    y = abs(p_WS[1] - gate[1] - hand * gate[9] * gate[7])
    # One eighth of the circle shows all: there, two facets may be the nearest.
    x, y = max(x, y), min(x, y)
    outwards = max(x * _C1 + y * _S1, x * _C3 + y * _S3)
    flank = outwards * _FLANK[0] + p_WS[2] * _FLANK[1] - _FLANK[2]
    tip = outwards * _TIP[0] + p_WS[2] * _TIP[1] - _TIP[2]
    return min(math.sqrt(dx * dx + dy * dy + dz * dz), max(flank, tip, p_WS[2] - _TOP))
