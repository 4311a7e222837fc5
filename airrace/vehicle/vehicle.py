"""The drone as data: mass, inertia, rotor table, drag, camera and gains."""

import dataclasses as dc
import math
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.common.errors import UserError
from airrace.common.immutable import read_only
from airrace.common.resources import load_yaml, models_path
from airrace.common.words import printable
from airrace.vehicle.allocation import wrench_margin
from airrace.vehicle.battery import Battery

GRAVITY = 9.81  # m/s^2
GRAVITY_W = read_only(np.array((0.0, 0.0, -GRAVITY)))  # in the world
DRONES = {"Default": "default", "StarOne": "star_one", "vadr": "vadr"}
# Those that race between pylons: the autonomy needs a camera that looks straight ahead.
RACERS = ("Default", "StarOne")
# Body x forward, y left, z up to camera x right, y down, z forward.
_R_BC_LEVEL = RotationMatrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dc.dataclass
class Rotor:
    """One rotor, thrusting along body z."""

    position: list[float] = dc.field(default_factory=list)  #: of the hub in B, [x, y, z] (m)
    direction: str = ""  #: "ccw" or "cw", seen from above
    thrust_coefficient: float = float("nan")  #: c_f in thrust = c_f w^2 (N s^2)
    torque_ratio: float = float("nan")  #: c_tf, drag torque per thrust (m)
    max_thrust: float = float("nan")  #: N
    radius: float = float("nan")  #: of the propeller's disc (m)

    @property
    def moment_ratio(self) -> float:
        """Moment on the body about z per thrust (m); a ccw rotor's is negative."""
        return -self.torque_ratio if self.direction == "ccw" else self.torque_ratio


@dc.dataclass
class Drag:
    """What the air does to the body, about each of its axes.

    With the velocity v of the body through the air and its angular velocity w,
    both in B, the force is -(linear + quadratic |v|) v and the moment -angular w,
    element by element.
    """

    linear: list[float] = dc.field(default_factory=lambda: [0.0] * 3)  #: of the rotors (N s/m)
    #: Of the airframe, half of rho c_d A (N s^2/m^2).
    quadratic: list[float] = dc.field(default_factory=lambda: [0.0] * 3)
    angular: list[float] = dc.field(default_factory=lambda: [0.0] * 3)  #: N m s


@dc.dataclass
class CameraMount:
    """Pose of the camera in the body."""

    #: Of its optical centre (m).
    position: list[float] = dc.field(default_factory=lambda: [0.0] * 3)
    #: Roll, pitch and yaw that turn it away from looking along body x; pitch is positive downwards.
    rpy_deg: list[float] = dc.field(default_factory=lambda: [0.0] * 3)

    @property
    def X_BC(self) -> RigidTransform:
        """Pose in B of the optical frame: x right, y down, z forward."""
        turn = RollPitchYaw(np.deg2rad(self.rpy_deg)).ToRotationMatrix()
        return RigidTransform(turn @ _R_BC_LEVEL, self.position)


@dc.dataclass
class ImuMount:
    """Where the inertial measurement unit is; its axes are those of the body."""

    position: list[float] = dc.field(default_factory=lambda: [0.0] * 3)  #: p_BI, in B (m)


@dc.dataclass
class Gains:
    """Controller gains per unit of mass and inertia, so that they suit any drone."""

    position: float = 7.0  #: 1/s^2
    velocity: float = 4.5  #: 1/s
    attitude: float = 180.0  #: 1/s^2
    angular_velocity: float = 22.0  #: 1/s


@dc.dataclass
class OriginalGains:
    """Controller gains of force and moment, as the system of the Student AirRace paper had them.

    They belong to one drone: a moment that suits a small inertia is too little for a large one.
    With a moment of inertia J, a mass m and rotors without lag, the linearised loop about a hover,
    J s^4 + k_w s^3 + k_R s^2 + k_R k_v / m s + k_R k_x / m, is stable where
    k_R k_v (k_w - J k_v / m) > k_w^2 k_x (Routh's criterion). For the Default that is below
    J = 0.26 kg m^2: its own 0.010 is, the 1 kg m^2 of the original simulator would not be.
    """

    position: float = float("nan")  #: k_x (N/m)
    velocity: float = float("nan")  #: k_v (N s/m)
    attitude: float = float("nan")  #: k_R (N m)
    angular_velocity: float = float("nan")  #: k_w (N m s)


@dc.dataclass
class Vehicle:
    """A multirotor."""

    name: str = ""  #: what results are filed under
    model: str = ""  #: SDF file beside the YAML file; its one link is named ``body``
    mass: float = float("nan")  #: kg
    inertia: list[float] = dc.field(default_factory=list)  #: principal moments in B (kg m^2)
    rotor_lag: float = float("nan")  #: time constant of a rotor's speed (s)
    rotors: list[Rotor] = dc.field(default_factory=list)  #: in the order of the rotor_speed_command
    camera: CameraMount = dc.field(default_factory=CameraMount)
    imu: ImuMount = dc.field(default_factory=ImuMount)
    drag: Drag = dc.field(default_factory=Drag)
    gains: Gains = dc.field(default_factory=Gains)  #: of the geometric controller
    original_gains: OriginalGains | None = None  #: None if the paper did not have the drone
    battery: Battery | None = None  #: of Betaflight's motors; None if its voltage does not fall
    #: Of the rotors' limits, what laps may take through Betaflight: its mixer needs the rest.
    betaflight_share: float = 0.95

    @property
    def allocation(self) -> np.ndarray:
        """Matrix from rotor thrusts to [f, Mx, My, Mz] in B, shape (4, n).

        Equations (1) and (2) of the Student AirRace paper, for any rotors:
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

    def with_thrusts(self, factors: Iterable[float]) -> "Vehicle":
        """Returns the drone with each rotor's thrust multiplied by a factor.

        A rotor's greatest thrust follows its coefficient: the speed limit is the motor's and stays.
        """
        rotors = [
            dc.replace(r, thrust_coefficient=r.thrust_coefficient * k, max_thrust=r.max_thrust * k)
            for r, k in zip(self.rotors, factors)
        ]
        return dc.replace(self, rotors=rotors)

    @property
    def radius(self) -> float:
        """Of the vertical cylinder that holds all propellers (m)."""
        return max(math.hypot(*r.position[:2]) + r.radius for r in self.rotors)

    def check(self) -> None:
        """Raises ValueError with one clause that says what is wrong."""

        def require(condition, message):
            if not condition:
                raise ValueError(message)

        def positive(*numbers):
            return all(np.isfinite(x) and x > 0 for x in numbers)

        require(self.name.strip(), "it has no name")
        require(self.name == printable(self.name), "its name has characters that are not seen")
        require(positive(self.mass), "mass must be a positive number")
        J = self.inertia
        require(len(J) == 3 and positive(*J), "inertia needs three positive numbers")
        require(2 * max(J) <= sum(J), "inertia breaks the triangle inequality")
        require(positive(self.rotor_lag), "rotor_lag must be positive")
        for name, numbers in (
            ("camera.position", self.camera.position),
            ("camera.rpy_deg", self.camera.rpy_deg),
            ("imu.position", self.imu.position),
        ):
            require(
                len(numbers) == 3 and np.all(np.isfinite(numbers)),
                f"{name} needs three finite numbers",
            )
        for name, numbers in vars(self.drag).items():
            require(
                len(numbers) == 3 and all(np.isfinite(x) and x >= 0 for x in numbers),
                f"drag.{name} needs three numbers that are not negative",
            )
        for i, r in enumerate(self.rotors, 1):
            require(
                len(r.position) == 3 and np.all(np.isfinite(r.position)),
                f"position of rotor {i} needs three finite numbers",
            )
            require(r.direction in ("ccw", "cw"), f"direction of rotor {i} must be ccw or cw")
            require(
                positive(r.thrust_coefficient, r.torque_ratio, r.max_thrust, r.radius),
                f"the coefficients of rotor {i} must be positive",
            )
        require(
            np.linalg.matrix_rank(self.allocation) == 4 if self.rotors else False,
            "its rotors cannot produce thrust and all three moments",
        )
        weight = self.mass * GRAVITY
        require(self.max_thrusts.sum() > weight, "its rotors cannot lift it")
        require(
            wrench_margin(self.allocation, self.max_thrusts, [weight, 0.0, 0.0, 0.0]) > 0,
            "its rotors cannot hold it level",
        )
        require(positive(*dc.astuple(self.gains)), "all gains must be positive")
        if self.original_gains is not None:
            require(
                positive(*dc.astuple(self.original_gains)),
                "all four original_gains must be positive",
            )
        if self.battery is not None:
            self.battery.check()
        require(0.1 <= self.betaflight_share <= 1.0, "betaflight_share must be from 0.1 to 1")


def find_vehicle(drone: str | os.PathLike[str]) -> Path:
    """Returns the path of the vehicle.yaml of a shipped drone, or in the folder of another.

    Raises:
        UserError: if there is neither.
    """
    drone = os.fspath(drone)
    if drone in DRONES:
        return models_path() / DRONES[drone] / "vehicle.yaml"
    path = os.path.join(drone, "vehicle.yaml")
    if os.path.isfile(path):
        return Path(path)
    raise UserError(
        f"There is no drone named '{drone}' and no file {path}; "
        f"choose from {', '.join(RACERS)}, or name the folder of your own."
    )


def checked_vehicle(vehicle: Vehicle, where: str) -> Vehicle:
    """Returns a vehicle that can fly; where: the file that it is from.

    Raises:
        UserError: if it cannot.
    """
    try:
        vehicle.check()
    except ValueError as e:
        raise UserError(f"The vehicle {where} cannot fly: {e}.") from None
    return vehicle


def load_vehicle(drone: str | os.PathLike[str]) -> tuple[Vehicle, Path]:
    """Returns a checked vehicle, and the path of its SDF file; see find_vehicle().

    Raises:
        UserError: if there is no such drone or its file is wrong.
    """
    path = find_vehicle(drone)
    vehicle = checked_vehicle(load_yaml(Vehicle, filename=path), str(path))
    sdf = path.parent / vehicle.model
    if not os.path.isfile(sdf):  # pathlib's raises on names that are too long
        raise UserError(f"The vehicle {path} names the model {sdf}, which does not exist.")
    return vehicle, sdf
