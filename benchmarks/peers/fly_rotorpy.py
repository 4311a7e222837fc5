"""rotorpy's Hummingbird on the circle, under rotorpy's SE(3) controller.

PYTHON_WITH_ROTORPY -m benchmarks.peers.fly_rotorpy
"""

from importlib.metadata import version

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.simulate import simulate
from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from benchmarks.peers import circle


def main() -> None:
    """Flies at rotorpy's own rate and at five times that, with sensors and without."""
    circle.on_one_core()
    circle.report(
        f"rotorpy {version('rotorpy')}",
        [
            circle.timed(
                fly(rate),
                controller="SE3Control",
                besides=besides,
                position_hz=rate,
                attitude_hz=rate,
                physics_hz=rate,
                integrator="RK45",
            )
            for rate in (100, 500)
            for fly, besides in ((with_sensors, "drag, IMU, motion capture, log"), (alone, "drag"))
        ],
    )


def parts():
    """Returns vehicle, controller, trajectory, and the state on the circle at its start."""
    hover = np.sqrt(quad_params["mass"] * 9.81 / 4.0 / quad_params["k_eta"])
    position, velocity = circle.derivatives(0.0)[:2]
    state = {
        "x": position,
        "v": velocity,
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, hover),
    }
    trajectory = ThreeDCircularTraj(
        center=np.array([0.0, 0.0, circle.HEIGHT]),
        freq=np.full(3, 1.0 / circle.PERIOD),
        radius=np.array([circle.RADIUS, circle.RADIUS, 0.0]),
    )
    return Multirotor(quad_params, state), SE3Control(quad_params), trajectory, state


def with_sensors(rate: float):
    """Returns a flight as by Environment.run(), without its plots, see circle.timed()."""
    vehicle, controller, trajectory, state = parts()
    e = Environment(vehicle, controller, trajectory, sim_rate=rate)

    def fly(start, end):
        # Time starts anew in each part: the circle, whole laps later, is the same.
        nonlocal state
        times, states, *_ = simulate(
            e.world,
            state,
            vehicle,
            controller,
            trajectory,
            e.wind_profile,
            e.imu,
            e.mocap,
            e.estimator,
            end - start,
            1.0 / rate,
            e.safety_margin,
            False,
            terminate=False,
        )
        state = {name: values[-1] for name, values in states.items()}
        return times, states["x"]

    return fly


def alone(rate: float):
    """Returns a flight by controller and vehicle alone, see circle.timed()."""
    vehicle, controller, trajectory, state = parts()

    def fly(start, end):
        nonlocal state
        times, positions = [], []
        for step in range(round(start * rate), round(end * rate)):
            time = step / rate
            control = controller.update(time, state, trajectory.update(time))
            state = vehicle.step(state, control, 1.0 / rate)
            times.append(time + 1.0 / rate)
            positions.append(state["x"])
        return times, positions

    return fly


if __name__ == "__main__":
    main()
