"""A world for explorers without pixels and physics: perfect flight, geometric visibility."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from scipy.special import expit

from airrace.math.random import make_generator
from airrace.scenario import PerceptionConfig, Scenario, StateEstimateConfig
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.mapping.gate_mapper import extrapolate
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.types import Detection, Detections, ExplorerStatus
from airrace.track import (
    BOARD_HEIGHT,
    BOARD_OFFSET,
    BOARD_SIZE,
    MARKER_SIZE,
    PYLON_BASE_RADIUS,
    PYLON_HEIGHT,
    Track,
)
from airrace.track.gate_map import GateMap
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.reference import NO_LIFT, REFERENCE_SIZE, as_reference
from airrace.vehicle import CameraMount, load_vehicle
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.state import STATE_SIZE, as_state
from tests.worlds.kinematic_flight import flat_state, noisy

_INFO = make_camera_info(width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=CameraMount().X_BC)
# What the detector reads in the realistic camera's pictures, by `benchmarks.perception`: half
# of the markers of this width, and none that are seen more obliquely or are less high.
_WIDTH, _SOFTNESS = 10.2, 0.6  # px
_MOST_OBLIQUE = np.cos(np.deg2rad(72.0))
_LEAST_HEIGHT = 17.0  # px
_SHUTTER, _MOST_BLUR = 0.004, 0.25  # s, and of a marker's width
# A pylon and its boards fit into an upright cylinder; that is what hides markers.
_HIDING_RADIUS = np.hypot(BOARD_OFFSET, BOARD_SIZE / 2)
_RATE = 20.0  # Hz, of the camera
_NOISE = 0.15  # px, of corners
_BOARD_RADIUS = 1.25  # m, of the cylinder around a pylon's boards


class ExplorationWorld(LeafSystem):
    """Flies the explorer's reference exactly, and sees what a camera would.

    .. pydrake_system::

        name: ExplorationWorld
        input_ports:
        - exploration_reference
        output_ports:
        - state_estimate
        - detections
        - gate_map

    The attitude is that of a multirotor with the reference's acceleration, so the camera
    turns up when it brakes. Markers are detected as often and as precisely as in pictures
    of the realistic camera, and mapped by the real ImageMapper. The state is kept in plain
    attributes, not in the Context: a world is used once.

    Attributes:
        path: positions so far, list of (3,).
    """

    def __init__(
        self, track: Track, *, seed=0, hidden=lambda id, p_WB: False, perception=PerceptionConfig()
    ):
        """Constructs the world with the drone on its pad.

        Args:
            track: with the true gates.
            seed: of the noise of observations and state estimate.
            hidden: (ID, p_WB) to whether something else hides a marker.
            perception: of the mapper.
        """
        LeafSystem.__init__(self)
        boards = track.boards()
        self._ids = np.array([board.id for board in boards])
        self._X_WM = [board.X_WM for board in boards]
        self._p_WM = np.array([X.translation() for X in self._X_WM])
        self._normals = np.array([X.rotation().col(2) for X in self._X_WM])
        self._pylons = track.pylons()[:, :2]
        self._hidden, self._seed = hidden, seed
        self._rng = make_generator(seed, "sight")
        self._mapper, self._mapped = ImageMapper(perception), MapperState()
        self._pad = self._state = _on_pad(track)
        self._estimate = self._state
        self._detections = Detections()
        self.path = []
        self._reference = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        now = {self.time_ticket()}  # and nothing of the input: no loop
        self.DeclareVectorOutputPort(
            "state_estimate", STATE_SIZE, lambda c, o: o.set_value(self._estimate), now
        )
        self.DeclareAbstractOutputPort(
            "detections",
            lambda: Value[object](Detections()),
            lambda c, o: o.set_value(self._detections),
            now,
        )
        self.DeclareAbstractOutputPort(
            "gate_map",
            lambda: Value[object](GateMap()),
            lambda c, o: o.set_value(self._mapped.gate_map),
            now,
        )
        self.DeclarePeriodicPublishEvent(1 / _RATE, 0.5 / _RATE, self._publish_observations)

    def _publish_observations(self, context):
        time = context.get_time()
        f = self._reference.Eval(context)
        idles = as_reference(f).acceleration[2] < NO_LIFT
        standing = idles or f[2] < as_state(self._pad).position[2] + 0.01
        state = self._pad.copy() if standing else flat_state(f, time)
        state[0] = time
        self._state = state
        self._estimate = noisy(state, StateEstimateConfig(), self._seed)
        self.path.append(as_state(state).position)
        X_WC = extrapolate(state, 0.0) @ _INFO.X_BC
        speed = np.linalg.norm(as_state(state).angular_velocity)
        markers = tuple(self._measure(i, X_WC) for i in self._visible(X_WC, speed))
        self._detections = Detections(time, markers)
        believed = extrapolate(self._estimate, 0.0) @ _INFO.X_BC
        self._mapped = self._mapper.updated(self._mapped, self._detections, believed, _INFO)

    def _visible(self, X_WC, turn_rate) -> np.ndarray:
        """Returns the indices of the boards that are read in a picture."""
        p_WC = X_WC.translation()
        rays = self._p_WM - p_WC
        distance = np.linalg.norm(rays, axis=1)
        p_CM = rays @ X_WC.rotation().matrix()
        depth = np.maximum(p_CM[:, 2], 1e-6)
        height = _INFO.K[0, 0] * MARKER_SIZE / depth
        facing = -np.sum(rays * self._normals, axis=1) / distance
        width = height * facing
        u, v = _INFO.K[:2] @ (p_CM / depth[:, None]).T
        margin = 0.75 * height
        seen = (p_CM[:, 2] > 0.5) & (height > _LEAST_HEIGHT)
        seen &= (facing > _MOST_OBLIQUE) & (np.abs(u - _INFO.width / 2) < _INFO.width / 2 - margin)
        seen &= np.abs(v - _INFO.height / 2) < _INFO.height / 2 - margin
        seen &= _SHUTTER * _INFO.K[0, 0] * turn_rate < _MOST_BLUR * width
        probability = 0.99 * expit((width - _WIDTH) / _SOFTNESS)
        seen &= self._rng.uniform(size=len(width)) < probability
        return [
            i
            for i in np.flatnonzero(seen)
            if not self._hidden(int(self._ids[i]), p_WC) and not self._is_occluded(i, p_WC)
        ]

    def _is_occluded(self, i, p_WC) -> bool:
        """Whether another pylon stands in the line of sight to a board."""
        others = np.delete(self._pylons, i // 2, axis=0)
        ray = (self._p_WM[i] - p_WC)[:2]
        along = np.clip((others - p_WC[:2]) @ ray / (ray @ ray), 0.0, 1.0)
        gaps = np.linalg.norm(p_WC[:2] + along[:, None] * ray - others, axis=1)
        return bool(gaps.min() < _HIDING_RADIUS)

    def _measure(self, i, X_WC) -> Detection:
        X_CM = X_WC.inverse() @ self._X_WM[i]
        p = X_CM.translation()
        angle = _NOISE / _INFO.K[0, 0]
        n = self._rng.standard_normal(6)
        across, along = p[2] * angle, p[2] ** 2 * angle / MARKER_SIZE
        tilt = 2 * p[2] * angle / MARKER_SIZE
        turn = RotationMatrix(RollPitchYaw(tilt * n[0], tilt * n[1], 0.0))
        p = p + along * n[5] * p / np.linalg.norm(p) + across * np.array([n[3], n[4], 0.0])
        return Detection(
            int(self._ids[i]), np.zeros((4, 2)), RigidTransform(turn @ X_CM.rotation(), p), 0.0
        )


def _on_pad(track: Track) -> np.ndarray:
    """Returns the state of the drone on its tilted pad, (14,)."""
    start = track.start
    downhill = np.deg2rad(start.pad_tilt_direction_deg)
    axis = RotationMatrix.MakeZRotation(downhill)
    tilt = axis @ RotationMatrix.MakeYRotation(np.deg2rad(start.pad_tilt_deg)) @ axis.inverse()
    R_WB = tilt @ RotationMatrix.MakeZRotation(np.deg2rad(start.heading_deg))
    x, y, z = start.position
    return np.array([0.0, *R_WB.ToQuaternion().wxyz(), x, y, z + 0.1, *np.zeros(6)])


@dc.dataclass(frozen=True)
class Exploration:
    """What happened.

    Attributes:
        status: the last one.
        path: positions, (n, 3) m, at the camera's rate.
        crossings: numbers of the gates flown through, below the pylons' tips, in
            order; negative, -1 - number, against their direction.
    """

    status: ExplorerStatus
    path: np.ndarray
    crossings: tuple


def make_explorer(track: Track, scenario: Scenario = Scenario()) -> Explorer:
    """Returns the explorer of a scenario on a track."""
    return Explorer(
        config=scenario.explorer,
        hover_height=track.hover_height,
        clearance=clearance_of(load_vehicle(scenario.drone)[0].radius),
    )


def explore(explorer, world: ExplorationWorld, track: Track, seconds: float) -> Exploration:
    """Explores until done, or for so many seconds."""
    builder = DiagramBuilder()
    builder.AddSystem(explorer)
    builder.AddSystem(world)
    for name in ("detections", "gate_map", "state_estimate"):
        builder.Connect(world.GetOutputPort(name), explorer.GetInputPort(name))
    builder.Connect(
        explorer.GetOutputPort("exploration_reference"), world.GetInputPort("exploration_reference")
    )
    simulator = Simulator(builder.Build())
    context = explorer.GetMyContextFromRoot(simulator.get_context())
    status, time = ExplorerStatus(), 0.0
    while not status.done and time < seconds:
        time += 0.5
        simulator.AdvanceTo(time)
        status = explorer.GetOutputPort("explorer_status").Eval(context)
    path = np.array(world.path)
    return Exploration(status, path, tuple(crossings(path, track)))


def crossings(path, track: Track) -> list:
    """Returns see Exploration; path: (n, 3) m."""
    found = []
    for n, gate in enumerate(track.gates):
        along, aside = (path - gate.p_WG) @ gate.forward, (path - gate.p_WG) @ gate.rightward
        for k in np.flatnonzero((along[:-1] < 0) != (along[1:] < 0)):
            s = along[k] / (along[k] - along[k + 1])
            at = aside[k] + s * (aside[k + 1] - aside[k])
            height = path[k, 2] + s * (path[k + 1, 2] - path[k, 2])
            if abs(at) < gate.pylon_spacing / 2 and height < 12.0:
                found.append((k, n if along[k] < 0 else -1 - n))
    return [n for _, n in sorted(found)]


def clear_of_pylons(path, track: Track, radius: float) -> float:
    """Returns the least room between a drone of a radius on a path and any pylon (m)."""
    beside = np.linalg.norm(path[:, None, :2] - track.pylons()[None, :, :2], axis=2)
    z = path[:, 2]
    cone = PYLON_BASE_RADIUS * np.clip(1.0 - z / PYLON_HEIGHT, 0.0, 1.0)
    at_boards = np.abs(z - BOARD_HEIGHT) < BOARD_SIZE / 2 + radius
    thick = np.maximum(cone, np.where(at_boards, _BOARD_RADIUS, 0.0))
    room = np.hypot(
        np.maximum(beside - thick[:, None], 0.0), np.maximum(z - PYLON_HEIGHT, 0.0)[:, None]
    )
    inside = np.minimum(beside - thick[:, None], 0.0) * (z < PYLON_HEIGHT)[:, None]
    return float((room + inside).min() - radius)
