"""A drone without a world, for Drake's own tools: linearization, LQR, direct collocation."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RpyFloatingJoint
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort, System
from pydrake.systems.primitives import LinearSystem

from airrace.systems.plant.multirotor import AddMultirotorModel, AddPropellers, ApplyForces
from airrace.systems.vector_function import VectorFunction
from airrace.vehicle import Vehicle

_COMMANDS, _JOINTS = ("thrusts", "rotor_speeds"), ("rpy", "quaternion")


def MakeDrone(
    vehicle: Vehicle,
    sdf: Path,
    *,
    command: Literal["thrusts", "rotor_speeds"] = "thrusts",
    lag: bool = False,
    joint: Literal["rpy", "quaternion"] = "rpy",
    time_step: float = 0.0,
) -> Diagram:
    """Builds a drone in the void, which converts to AutoDiffXd and to Expression.

    .. pydrake_system::

        name: drone
        input_ports:
        - thrusts (or rotor_speed_command)
        output_ports:
        - state

    It is the model that the Simulation flies, by the same functions, without what is not smooth:
    no ground, no limits of the rotors, no failures; and without drag.

    Args:
        vehicle, sdf: the drone, from load_vehicle().
        command: what the rotors are given: ``thrusts`` (N) or speeds (rad/s), one a rotor.
        lag: whether they follow commands of their speed with the vehicle's time constant. Their
            speeds are states then, behind those of the plant.
        joint: of the body to the world: ``rpy`` has the positions roll, pitch, yaw (rad), x, y, z
            (m), so that what Linearize() makes of a hover can be controlled; it is singular where
            the nose points up or down. ``quaternion`` is that of the Simulation, w, x, y, z before
            the position. Velocities are the same for both, angular (rad/s) before linear (m/s), in
            the world.
        time_step: of a discrete plant (s); 0 for a continuous one. Drake linearizes no discrete
            system with states in two places, as a discrete drone with lag has them.

    Raises:
        ValueError: if an argument is none of these, or ``lag`` is asked for with thrusts.
        UserError: if the SDF file does not agree with the vehicle.
    """
    for name, value, choices in (("command", command, _COMMANDS), ("joint", joint, _JOINTS)):
        if value not in choices:
            raise ValueError(f"{name} must be one of {', '.join(choices)}, not {value!r}.")
    if not 0.0 <= time_step < np.inf:
        raise ValueError(f"time_step must be 0 or a positive number of seconds, not {time_step}.")
    if lag and command == "thrusts":
        raise ValueError("lag is of rotor speeds: make the drone with command='rotor_speeds'.")
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(time_step))
    if time_step:
        plant.SetUseSampledOutputPorts(False)  # which would be a state that is no number
    body = AddMultirotorModel(plant, vehicle, sdf)
    if joint == "rpy":
        plant.AddJoint(RpyFloatingJoint("floating", plant.world_frame(), body.body_frame()))
    plant.Finalize()
    thrusts, forces = AddPropellers(builder, body, vehicle)
    ApplyForces(builder, plant, [forces])
    if command == "thrusts":
        builder.ExportInput(thrusts, "thrusts")
    else:
        commands, made = _add_rotors(builder, vehicle, lag, time_step)
        builder.Connect(made, thrusts)
        builder.ExportInput(commands, "rotor_speed_command")
    builder.ExportOutput(plant.get_state_output_port(), "state")
    diagram = builder.Build()
    diagram.set_name("drone")
    return diagram


def _add_rotors(
    builder: DiagramBuilder, vehicle: Vehicle, lag: bool, time_step: float
) -> tuple[InputPort, OutputPort]:
    """Adds what makes thrusts c_f w^2 (N) of rotor speed commands (rad/s); returns its ends."""
    c_f = vehicle.thrust_coefficients
    n, eye = len(c_f), np.eye(len(c_f))
    thrusts = builder.AddSystem(VectorFunction(lambda w: c_f * w * w, n, n, "rotor_thrusts"))
    if not lag:
        return thrusts.get_input_port(), thrusts.get_output_port()
    # Solved exactly over a step, as the Simulation's are.
    kept = np.exp(-time_step / vehicle.rotor_lag)
    A, B = (kept, 1.0 - kept) if time_step else (-1.0 / vehicle.rotor_lag, 1.0 / vehicle.rotor_lag)
    speeds = LinearSystem(A * eye, B * eye, eye, 0.0 * eye, time_step)
    builder.AddNamedSystem("rotor_speeds", speeds)
    builder.Connect(speeds.get_output_port(), thrusts.get_input_port())
    return speeds.get_input_port(), thrusts.get_output_port()


def MakeRpyState() -> System:
    """Makes the state of a drone of MakeDrone() out of ``truth.state`` of the Simulation.

    .. pydrake_system::

        name: rpy_state
        input_ports:
        - input
        output_ports:
        - output

    ``input`` has a quaternion (13), ``output`` roll, pitch and yaw in its place (12).
    """

    def without_quaternion(state):
        # Drake's plant lets the length of its quaternion drift.
        w, x, y, z = state[:4] / np.sqrt(state[:4].dot(state[:4]))
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(2.0 * (w * y - x * z))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return [roll, pitch, yaw, *state[4:]]

    return VectorFunction(without_quaternion, 13, 12, "rpy_state")


def MakeRotorSpeeds(vehicle: Vehicle) -> System:
    """Makes the rotor speeds (rad/s) at which a vehicle's rotors have some thrusts (N), both (n,).

    .. pydrake_system::

        name: speeds_of_thrusts
        input_ports:
        - input
        output_ports:
        - output

    A negative thrust gets the speed 0.
    """
    c_f, n = vehicle.thrust_coefficients, len(vehicle.rotors)
    return VectorFunction(
        lambda thrusts: np.sqrt((thrusts + np.abs(thrusts)) / (2.0 * c_f)),
        n,
        n,
        "speeds_of_thrusts",
    )
