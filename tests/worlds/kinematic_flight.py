"""A flight without physics: the drone is exactly where its reference is."""

import numpy as np
from pydrake.math import RotationMatrix

from airrace.math.random import make_generator
from airrace.systems.estimation.state_filter import StateFilter
from airrace.track import Track
from airrace.trajopt.feasibility import clearance_of
from airrace.trajopt.flatness import attitude_from_force, heading_vectors
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import State, as_state, state_vector
from tests.worlds.published_laps import Course


class Flight:
    """Laps along a closed trajectory, flown without any error.

    Attributes:
        duration: of all laps (s).
    """

    def __init__(self, trajectory, laps: int):
        """Args: trajectory: a FlatTrajectory. laps: how many."""
        self._trajectory = trajectory
        self.duration = laps * trajectory.duration

    def acceleration(self, time: float) -> np.ndarray:
        """Returns it at a time (s), (3,) m/s^2."""
        reference = self._trajectory.reference(time % self._trajectory.duration)
        return as_reference(reference).acceleration

    def state(self, time: float) -> np.ndarray:
        """Returns the vector of vehicle/state.py at a time (s), without noise, (14,)."""
        f = self._trajectory.reference(time % self._trajectory.duration)
        return flat_state(f, time)


def flat_state(f, time: float) -> np.ndarray:
    """Returns the vector of vehicle/state.py of a drone that is on a reference, (14,).

    Args:
        f: the sample of trajopt/reference.py, (18,).
        time: (s).
    """
    r = as_reference(f)
    axes, w_B, _ = attitude_from_force(
        r.acceleration + [0.0, 0.0, GRAVITY],
        r.jerk,
        r.snap,
        heading_vectors(np.cos(r.yaw), np.sin(r.yaw), r.yaw_rate, r.yaw_acceleration),
    )
    R_WB = RotationMatrix.ProjectToRotationMatrix(np.column_stack(axes))
    quaternion = R_WB.ToQuaternion().wxyz()
    return state_vector(State(time, quaternion, r.position, R_WB @ np.array(w_B), r.velocity))


def fly_laps(track: Track, dimensions: int, limits, laps: int) -> Flight:
    """Returns laps through all gates.

    Args:
        track: where.
        dimensions: see plan_circuit.
        limits: of speed (m/s) and acceleration (m/s^2).
        laps: how many.
    """
    course, vehicle = Course.of(track), load_vehicle("Default")[0]
    constraints = FlightConstraints(
        course.pylons,
        clearance_of(vehicle.radius),
        FlightLimits(vehicle, max_speed=limits[0], max_acceleration=limits[1]),
    )
    lap = plan_circuit(course.midpoints, course.headings, dimensions, constraints)
    return Flight(lap, laps)


def filtered(flight: Flight, config, seed: int) -> np.ndarray:
    """Returns what a StateFilter makes of noisy states, one before every sample, (K, 14).

    Args:
        flight: by the Default drone.
        config: a StateEstimateConfig.
        seed: of the noise.
    """
    vehicle = load_vehicle("Default")[0]
    thrust_per_speed2 = vehicle.thrust_coefficients.sum()
    state_filter = StateFilter(vehicle=vehicle, state_rate=config.rate, rate=config.rate)
    context = state_filter.CreateDefaultContext()
    output = state_filter.GetOutputPort("filtered_estimate")
    estimate, speeds = (
        state_filter.GetInputPort(name) for name in ("state_estimate", "rotor_speeds")
    )
    results = []
    for k in range(int(flight.duration * config.rate) + 1):
        time = k / config.rate
        context.SetTime(time)
        force = vehicle.mass * np.linalg.norm(flight.acceleration(time) + [0.0, 0.0, GRAVITY])
        speeds.FixValue(context, np.full(len(vehicle.rotors), np.sqrt(force / thrust_per_speed2)))
        new = noisy(flight.state(time), config, seed)
        if k == 0:
            estimate.FixValue(context, new)
        results.append(output.Eval(context).copy())  # as sampled before the estimate is there
        estimate.FixValue(context, new)
        after = state_filter.EvalUniquePeriodicDiscreteUpdate(context)
        context.SetDiscreteState(after)
    return np.array(results)


def noisy(state, config, seed: int) -> np.ndarray:
    """Returns a state with the noise of a StateEstimateConfig, drawn by its time, (14,)."""
    n = make_generator(seed, "benchmark", round(as_state(state).time * 1e6)).standard_normal(5)
    result = state.copy()
    estimate = as_state(result)
    estimate.position[:] += config.position_sigma * n[:3]
    estimate.velocity[:2] *= 1.0 + config.velocity_sigma * n[3:]
    return result
