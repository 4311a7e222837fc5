"""A drone that stands before a gate, without a simulation.

It is for computers that have the autonomy alone, and for compiling what the autonomy calls: nothing
that simulates or draws is called, so that its machine code is not needed there.
"""

import dataclasses as dc
import functools
import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform

from airrace.rendering.scene.textures import BLACK, WHITE, marker_modules
from airrace.systems.estimation.navigation import Navigation, navigation_vector
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.sensing.imu_samples import IMU_DEPTH, NO_SAMPLES, SAMPLE_SIZE
from airrace.systems.sensing.picture_ports import COLOUR, IMAGE_TYPES, PICTURE_PORTS
from airrace.track.track import BOARD_SIZE, MARKER_SIZE, Gate
from airrace.trajopt.flat_trajectory import hold
from airrace.vehicle import load_vehicle
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.state import State, state_vector
from airrace.vehicle.vehicle import GRAVITY

if TYPE_CHECKING:
    from airrace.scenario import Scenario

_DISTANCE = 15.0  # m, of the gate
_SKY = 190  # grey level all around the boards
_MODULE = 16  # px of a board's texture
# In the end it says that it tumbles, so that rotors come to their limits.
_TUMBLE, _TUMBLE_RATE = 0.05, 20.0  # s, rad/s
_SWAY, _SWAY_RATE = 0.01, 6.0  # m, rad/s: no two pictures are the same
_PLAN = dc.replace(NO_PLAN, lap=1)
_IDLE = 0.15  # s, with `vio`: an estimator begins where the rotors do not turn yet


class Standing:
    """What the ports of the simulation and of the autonomy's halves would show."""

    def __init__(self, scenario: "Scenario", duration: float):
        """Args: scenario: whose drone, camera and rates to use. duration: of it all (s)."""
        vehicle, _ = load_vehicle(scenario.drone)
        self._info = scenario.camera.info(vehicle.camera.X_BC)
        thrust = vehicle.mass * GRAVITY / len(vehicle.rotors)
        self._tumbling = duration - _TUMBLE  # since when (s)
        self._speeds = np.sqrt(thrust / vehicle.thrust_coefficients)
        self._turning = _IDLE if scenario.localizes else -1.0  # since when (s)
        self._imu_rate = scenario.imu.rate

    def of(self, port: str, time: float) -> Any:
        """Returns the value of a port of the simulation at a time (s)."""
        p_WB = np.array([0.0, _SWAY * np.sin(_SWAY_RATE * time), 0.0])
        w_WB = np.array([float(time > self._tumbling) * _TUMBLE_RATE, 0.0, 0.0])
        speeds = self._speeds * (time > self._turning)
        match port:
            case "state_estimate":
                upright = np.array([1.0, 0.0, 0.0, 0.0])
                return state_vector(State(time, upright, p_WB, w_WB, np.zeros(3)))
            case "camera_info":
                return self._info
            case "camera_image_time":
                return np.array([time])
            case "rotor_status":
                return np.hstack([time, speeds, speeds])
            case "rotor_speeds":
                return speeds
            case "imu":
                return self._samples(time, w_WB)
        picture = draw_gate(self._info, RigidTransform(p_WB) @ self._info.X_BC)
        if PICTURE_PORTS[port].picture == COLOUR:
            picture = cv2.cvtColor(picture, cv2.COLOR_GRAY2RGBA)
        return PICTURE_PORTS[port].value_of(picture)

    def told(self, port: str, first: Any, time: float) -> Any:
        """Returns the value that a half of the autonomy has on a port at a time (s).

        Args: first: what it holds at first; of a system of the user's, nothing else is known.
        """
        match port:
            case "state_estimate" | "filtered_estimate" | "rotor_speeds":
                return self.of(port.replace("filtered", "state"), time)
            case "imu_history":
                return self._samples(time, np.zeros(3), len(first) // SAMPLE_SIZE)
            case "corrections":
                state = Navigation(time, np.eye(4)[0], *np.zeros((4, 3)))
                return navigation_vector(state)
            case "exploration_reference":
                return hold([0.0, 0.0, 0.0], 0.0)
            case "lap_plan":
                return _PLAN if time > self._tumbling / 2 else first
        return first

    def _samples(self, time: float, w_WB: np.ndarray, depth: int = IMU_DEPTH) -> np.ndarray:
        """Returns what the IMU shows at a time (s), see sensing/imu_samples.py."""
        rows = np.tile(NO_SAMPLES.reshape(IMU_DEPTH, SAMPLE_SIZE)[0], (depth, 1))
        times = time - np.arange(depth) / self._imu_rate
        rows[times > 0.0] = [0.0, *w_WB, 0.0, 0.0, GRAVITY]
        rows[times > 0.0, 0] = times[times > 0.0]
        return rows.ravel()


class StandingDrone(LeafSystem):
    """Shows a part of the autonomy what it would get from all others.

    .. pydrake_system::

        name: StandingDrone
        output_ports:
        - the ports that are asked for
    """

    def __init__(
        self, standing: Standing, initial: Mapping[str, Any], given: Collection[str], fps: float
    ):
        """Constructs it.

        Args:
            standing: the values.
            initial: name of a port of the autonomy's to what it holds at first.
            given: names of ports of the simulation's.
            fps: of the camera (Hz): its pictures are held, since to draw one takes its time.
        """
        LeafSystem.__init__(self)
        for name, first in initial.items():
            self._declare(name, first, functools.partial(standing.told, name, first))
        for name in given:
            rate = fps if name in PICTURE_PORTS or name == "camera_image_time" else math.inf
            value_at = functools.partial(_held, standing, name, rate)
            self._declare(name, value_at(0.0), value_at)

    def _declare(self, name, first, value_at):
        def calc(context, output):
            output.set_value(value_at(context.get_time()))

        ticket = {self.time_ticket()}
        if isinstance(first, np.ndarray):
            self.DeclareVectorOutputPort(name, len(first), calc, ticket)
        else:
            model = Value[IMAGE_TYPES.get(name, object)]
            self.DeclareAbstractOutputPort(name, lambda: model(first), calc, ticket)


def _held(standing: Standing, port: str, rate: float, time: float) -> Any:
    """Returns the value of a port that changes at a rate (Hz)."""
    return standing.of(port, time if rate == math.inf else math.floor(time * rate + 1e-6) / rate)


def draw_gate(info: CameraInfo, X_WC: RigidTransform) -> np.ndarray:
    """Returns a picture of the boards of a gate before a grey sky, (h, w), uint8.

    Args:
        info: of the camera; its distortion is left out.
        X_WC: its pose; the gate is 15 m from the origin, towards +x.
    """
    picture = np.full((info.height, info.width), _SKY, np.uint8)
    for board in Gate(left_pylon=[_DISTANCE, 5.0], heading_deg=0.0).boards(0):
        X_CM = X_WC.inverse() @ board.X_WM
        if X_CM.inverse().translation()[2] <= 0.0:
            continue  # its back is seen
        corners = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * BOARD_SIZE / 2
        p_C = X_CM @ corners.T
        if (p_C[2] <= 0.0).any():
            continue
        pixels = (info.K @ (p_C / p_C[2]))[:2].T
        texture = _texture(board.id)
        side = len(texture) - 0.5
        of_texture = np.array([[-0.5, -0.5], [side, -0.5], [side, side], [-0.5, side]])
        H = cv2.getPerspectiveTransform(of_texture.astype(np.float32), pixels.astype(np.float32))
        cv2.warpPerspective(
            texture,
            H,
            picture.shape[::-1],
            dst=picture,
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
    return picture


def _texture(marker_id: int) -> np.ndarray:
    """Returns the face of a board: a marker in its white border, uint8."""
    modules = np.where(marker_modules(marker_id), WHITE, BLACK).astype(np.uint8)
    marker = np.kron(modules, np.ones((_MODULE, _MODULE), np.uint8))
    border = round(len(marker) * (BOARD_SIZE / MARKER_SIZE - 1.0) / 2)
    return cv2.GaussianBlur(np.pad(marker, border, constant_values=int(WHITE)), (0, 0), 1.0)
