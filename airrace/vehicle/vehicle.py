"""The drone as data: mass, inertia, rotor table, drag, camera and gains."""

import dataclasses as dc
import math
import os
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.common.errors import UserError
from airrace.common.immutable import read_only
from airrace.common.resources import load_yaml, models_path
from airrace.vehicle.allocation import wrench_margin

GRAVITY = 9.81  # m/s^2
GRAVITY_W = read_only(np.array((0.0, 0.0, -GRAVITY)))  # in the world
DRONES = {"Default": "default", "StarOne": "star_one", "vadr": "vadr"}
# Those that race between pylons: the autonomy needs a camera that looks straight ahead.
RACERS = ("Default", "StarOne")
# Body x forward, y left, z up to camera x right, y down, z forward.
_R_BC_LEVEL = RotationMatrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dc.dataclass
class Rotor:
    """One rotor, thrusting along body z.

    Attributes:
        position: of the hub in the body frame, [x, y, z] (m).
        direction: "ccw" or "cw", seen from above.
        thrust_coefficient: c_f in thrust = c_f w^2 (N s^2).
        torque_ratio: c_tf, drag torque per thrust (m).
        max_thrust: (N).
        radius: of the propeller's disc (m).
    """

    position: list[float] = dc.field(default_factory=list)
    direction: str = ""
    thrust_coefficient: float = float("nan")
    torque_ratio: float = float("nan")
    max_thrust: float = float("nan")
    radius: float = float("nan")

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

    Attributes:
        linear: of the rotors in their inflow, [x, y, z] (N s/m).
        quadratic: of the airframe, half of rho c_d A, [x, y, z] (N s^2/m^2).
        angular: [x, y, z] (N m s).
    """

    linear: list[float] = dc.field(default_factory=lambda: [0.0] * 3)
    quadratic: list[float] = dc.field(default_factory=lambda: [0.0] * 3)
    angular: list[float] = dc.field(default_factory=lambda: [0.0] * 3)


@dc.dataclass
class CameraMount:
    """Pose of the camera in the body.

    Attributes:
        position: of the optical centre in the body frame, [x, y, z] (m).
        rpy_deg: roll, pitch and yaw that turn it away from looking along body
            x; pitch is positive downwards.
    """

    position: list[float] = dc.field(default_factory=lambda: [0.0] * 3)
    rpy_deg: list[float] = dc.field(default_factory=lambda: [0.0] * 3)

    @property
    def X_BC(self) -> RigidTransform:
        """Pose in B of the optical frame: x right, y down, z forward."""
        turn = RollPitchYaw(np.deg2rad(self.rpy_deg)).ToRotationMatrix()
        return RigidTransform(turn @ _R_BC_LEVEL, self.position)


@dc.dataclass
class ImuMount:
    """Where the inertial measurement unit is; its axes are those of the body.

    Attributes:
        position: p_BI in the body frame, [x, y, z] (m).
    """

    position: list[float] = dc.field(default_factory=lambda: [0.0] * 3)


@dc.dataclass
class Gains:
    """Controller gains per unit of mass and inertia, so that they suit any drone.

    Attributes:
        position: (1/s^2). velocity: (1/s).
        attitude: (1/s^2). angular_velocity: (1/s).
    """

    position: float = 7.0
    velocity: float = 4.5
    attitude: float = 180.0
    angular_velocity: float = 22.0


@dc.dataclass
class OriginalGains:
    """Controller gains of force and moment, as the system of the Student AirRace paper had them.

    They belong to one drone: a moment that suits a small inertia is too little for a large one.
    With a moment of inertia J, a mass m and rotors without lag, the linearised loop about a hover,
    J s^4 + k_w s^3 + k_R s^2 + k_R k_v / m s + k_R k_x / m, is stable where
    k_R k_v (k_w - J k_v / m) > k_w^2 k_x (Routh's criterion). For the Default that is below
    J = 0.26 kg m^2: its own 0.010 is, the 1 kg m^2 of the original simulator would not be.

    Attributes:
        position: k_x (N/m). velocity: k_v (N s/m).
        attitude: k_R (N m). angular_velocity: k_w (N m s).
    """

    position: float = float("nan")
    velocity: float = float("nan")
    attitude: float = float("nan")
    angular_velocity: float = float("nan")


@dc.dataclass
class Vehicle:
    """A multirotor.

    Attributes:
        name: what results are filed under.
        model: SDF file beside the YAML file; its one link is named ``body``.
        mass: (kg).
        inertia: principal moments about the body axes, [Jx, Jy, Jz] (kg m^2).
        rotor_lag: time constant of a rotor's speed (s).
        rotors: in the order of the rotor_speed_command.
        camera, imu, drag: see there.
        gains: of the geometric controller.
        original_gains: the same, of the Student AirRace paper; None if that did not have the drone.
    """

    name: str = ""
    model: str = ""
    mass: float = float("nan")
    inertia: list[float] = dc.field(default_factory=list)
    rotor_lag: float = float("nan")
    rotors: list[Rotor] = dc.field(default_factory=list)
    camera: CameraMount = dc.field(default_factory=CameraMount)
    imu: ImuMount = dc.field(default_factory=ImuMount)
    drag: Drag = dc.field(default_factory=Drag)
    gains: Gains = dc.field(default_factory=Gains)
    original_gains: OriginalGains | None = None

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


def find_vehicle(drone: str) -> Path:
    """Returns the path of a drone's vehicle.yaml.

    Args:
        drone: the name of a shipped drone, or the folder of another.

    Raises:
        UserError: if there is neither.
    """
    if drone in DRONES:
        return models_path() / DRONES[drone] / "vehicle.yaml"
    path = os.path.join(drone, "vehicle.yaml")
    if os.path.isfile(path):
        return Path(path)
    raise UserError(
        f"There is no drone named '{drone}' and no file {path}; "
        f"choose from {', '.join(RACERS)}, or name the folder of your own."
    )


def load_vehicle(drone: str) -> tuple[Vehicle, Path]:
    """Loads and checks a vehicle.

    Args:
        drone: the name of a shipped drone, or the folder of another.

    Returns:
        the vehicle, and the path of its SDF file.

    Raises:
        UserError: if there is no such drone or its file is wrong.
    """
    path = find_vehicle(drone)
    vehicle = load_yaml(Vehicle, filename=path)
    try:
        vehicle.check()
    except ValueError as e:
        raise UserError(f"The vehicle {path} cannot fly: {e}.") from None
    sdf = path.parent / vehicle.model
    if not os.path.isfile(sdf):  # pathlib's raises on names that are too long
        raise UserError(f"The vehicle {path} names the model {sdf}, which does not exist.")
    return vehicle, sdf
