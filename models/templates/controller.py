"""A controller of your own. It flies as it is: change calc_wrench() and race again.

    airrace race --track hexagon --laps 1 --scenario_text '{systems: {geometric_controller: "NAME:make"}}'

A system takes the place of another one if its ports have the same names. This one has
those of GeometricController, which also divides the wrench among the rotors, and brings the
drone down when too many of them are lost; what is written here is the control law itself.
"""

import numpy as np

from airrace.math.quaternion import rotation_matrix
from airrace.systems.control.geometric_controller import GeometricController
from airrace.trajopt.reference import as_reference
from airrace.vehicle import GRAVITY_W, load_vehicle
from airrace.vehicle.state import as_state

K_X, K_V = 7.0, 4.5  # 1/s^2, 1/s: gains on the errors of position and velocity
K_R = np.array([180.0, 180.0, 40.0])  # 1/s^2, on the error of attitude: roll, pitch, yaw
K_W = np.array([22.0, 22.0, 12.0])  # 1/s, on the error of angular velocity


class MyController(GeometricController):
    """Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010.

    W is the world, B the body, D the desired attitude. Without the paper's feed-forward: the
    desired angular velocity and acceleration are zero.
    """

    def __init__(self, vehicle, rate):
        """Args: vehicle: the drone, as its file says. rate: of the control loop (Hz)."""
        GeometricController.__init__(self, vehicle=vehicle, rate=rate)
        self._mass, self._inertia = vehicle.mass, np.array(vehicle.inertia)

    def calc_wrench(self, reference, estimate):
        """Returns total thrust (N) and moments about the body's axes (N m), (4,).

        Args:
            reference: vector of a Reference, (18,): where the drone should be.
            estimate: vector of a State, (14,): where it is.
        """
        reference, state = as_reference(reference), as_state(estimate)
        # What the rotors must add to gravity (m/s^2).
        force = (
            K_X * (reference.position - state.position)
            + K_V * (reference.velocity - state.velocity)
            + reference.acceleration
            - GRAVITY_W
        )
        R_WB = rotation_matrix(state.quaternion)
        R_WD = attitude_from_force(force, reference.yaw)
        e_R = 0.5 * vee(R_WD.T @ R_WB - R_WB.T @ R_WD)
        w = R_WB.T @ state.angular_velocity
        moments = self._inertia * (-K_R * e_R - K_W * w) + np.cross(w, self._inertia * w)
        thrust = self._mass * max(force @ R_WB[:, 2], 0.0)
        return np.array([thrust, *moments])


def attitude_from_force(force, yaw):
    """Returns R_WD: z along the force (3,), x as near to the yaw (rad) as that allows."""
    z = force / np.linalg.norm(force)
    y = np.cross(z, [np.cos(yaw), np.sin(yaw), 0.0])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def vee(S):
    """Returns the vector of a skew-symmetric matrix (3, 3)."""
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


def make(scenario):
    """Returns the system; called once before a race, with everything that is known of it."""
    vehicle, _ = load_vehicle(scenario.drone)
    return MyController(vehicle, scenario.controller.rate)
