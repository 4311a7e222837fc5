"""The drone as data: mass, inertia, rotor table, camera and gains."""

import dataclasses as dc
import typing
from pathlib import Path

import numpy as np

from airrace.errors import UserError
from airrace.resources import load_yaml, models_path

GRAVITY = 9.81
DRONES = {"Default": "default"}


@dc.dataclass
class Rotor:
    """One rotor, thrusting along body z.

    Attributes:
        position: of the hub in the body frame, [x, y, z] (m).
        direction: "ccw" or "cw", seen from above.
        thrust_coefficient: c_f in thrust = c_f w^2 (N s^2).
        torque_ratio: c_tf, drag torque per thrust (m).
        max_thrust: (N).
    """

    position: typing.List[float] = dc.field(default_factory=list)
    direction: str = ""
    thrust_coefficient: float = float("nan")
    torque_ratio: float = float("nan")
    max_thrust: float = float("nan")

    @property
    def moment_ratio(self) -> float:
        """Moment on the body about z per thrust (m); a ccw rotor's is negative."""
        return -self.torque_ratio if self.direction == "ccw" else self.torque_ratio


@dc.dataclass
class Gains:
    """Controller gains per unit of mass and inertia.

    Attributes:
        position: (1/s^2). velocity: (1/s).
        attitude: (1/s^2). angular_velocity: (1/s).
    """

    position: float = float("nan")
    velocity: float = float("nan")
    attitude: float = float("nan")
    angular_velocity: float = float("nan")


@dc.dataclass
class Vehicle:
    """A multirotor.

    Attributes:
        name: the name on the command line.
        model: SDF file beside the YAML file; its one link is named ``body``.
        mass: (kg).
        inertia: principal moments about the body axes, [Jx, Jy, Jz] (kg m^2).
        rotor_lag: time constant of a rotor's speed (s).
        rotors: in the order of the rotor_speed_command.
        camera_position: of the camera in the body frame (m).
        gains: of the geometric controller.
    """

    name: str = ""
    model: str = ""
    mass: float = float("nan")
    inertia: typing.List[float] = dc.field(default_factory=list)
    rotor_lag: float = float("nan")
    rotors: typing.List[Rotor] = dc.field(default_factory=list)
    camera_position: typing.List[float] = dc.field(default_factory=list)
    gains: Gains = dc.field(default_factory=Gains)

    @property
    def allocation(self) -> np.ndarray:
        """Matrix from rotor thrusts to [f, Mx, My, Mz] in B, shape (4, n).

        Equations (1) and (2) of the Student AirRace report, for any rotors:
        a thrust f_i along z at (x, y, 0) gives the moment (y f_i, -x f_i).
        """
        return np.array(
            [[1.0, r.position[1], -r.position[0], r.moment_ratio] for r in self.rotors]
        ).T

    @property
    def thrust_coefficients(self) -> np.ndarray:
        """c_f of every rotor (N s^2), shape (n,)."""
        return np.array([r.thrust_coefficient for r in self.rotors])

    @property
    def max_thrusts(self) -> np.ndarray:
        """Thrust limit of every rotor (N), shape (n,)."""
        return np.array([r.max_thrust for r in self.rotors])

    @property
    def max_speeds(self) -> np.ndarray:
        """Speed limit of every rotor (rad/s), shape (n,)."""
        return np.sqrt(self.max_thrusts / self.thrust_coefficients)

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""

        def require(condition, message):
            if not condition:
                raise ValueError(message)

        def positive(*numbers):
            return all(np.isfinite(x) and x > 0 for x in numbers)

        require(positive(self.mass), "mass must be a positive number")
        J = self.inertia
        require(len(J) == 3 and positive(*J), "inertia needs three positive numbers")
        require(2 * max(J) <= sum(J), "inertia breaks the triangle inequality")
        require(positive(self.rotor_lag), "rotor_lag must be positive")
        require(len(self.camera_position) == 3 and np.all(np.isfinite(self.camera_position)),
                "camera_position needs three finite numbers")
        for i, r in enumerate(self.rotors, 1):
            require(len(r.position) == 3 and np.all(np.isfinite(r.position)),
                    f"position of rotor {i} needs three finite numbers")
            require(r.direction in ("ccw", "cw"), f"direction of rotor {i} must be ccw or cw")
            require(positive(r.thrust_coefficient, r.torque_ratio, r.max_thrust),
                    f"the coefficients of rotor {i} must be positive")
        require(np.linalg.matrix_rank(self.allocation) == 4 if self.rotors else False,
                "its rotors cannot produce thrust and all three moments")
        require(self.max_thrusts.sum() > self.mass * GRAVITY, "its rotors cannot lift it")
        require(positive(*dc.astuple(self.gains)), "all gains must be positive")


def load_vehicle(drone: str) -> tuple[Vehicle, Path]:
    """Loads and checks a vehicle.

    Args:
        drone: the name of a shipped drone.

    Returns:
        the vehicle, and the path of its SDF file.

    Raises:
        UserError: if the name is unknown or the file is wrong.
    """
    if drone not in DRONES:
        raise UserError(f"There is no drone named '{drone}'; choose from: {', '.join(DRONES)}.")
    path = models_path() / DRONES[drone] / "vehicle.yaml"
    vehicle = load_yaml(Vehicle, filename=path)
    try:
        vehicle.check()
    except ValueError as e:
        raise UserError(f"The vehicle {path} cannot fly: {e}.") from None
    sdf = path.parent / vehicle.model
    if not sdf.is_file():
        raise UserError(f"The vehicle {path} names the model {sdf}, which does not exist.")
    return vehicle, sdf
