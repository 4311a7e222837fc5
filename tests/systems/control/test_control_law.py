"""The control law: the paper's to the letter, and what it does about a hover."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RotationMatrix

from airrace.common.errors import UserError
from airrace.systems.control.control_law import lee_wrench, limited, make_parameters
from airrace.trajopt.reference import Reference
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from airrace.vehicle.state import State

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
ORIGINAL = {name: make_parameters(each, "lee", "original") for name, each in VEHICLES.items()}
both_drones = pytest.mark.parametrize("drone", VEHICLES)
REST = np.zeros(3)
E3 = np.array([0.0, 0.0, 1.0])
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
headings = st.floats(-np.pi, np.pi)
rotations = (
    st.tuples(*[numbers] * 4)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


def hat(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def vee(S):
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


def papers_wrench(vehicle: Vehicle, reference: Reference, state: State) -> np.ndarray:
    """Returns equations (15) and (16) with original_gains, w_d and its derivative zero, (4,)."""
    k, J = vehicle.original_gains, np.diag(vehicle.inertia)
    force = (
        k.position * (reference.position - state.position)
        + k.velocity * (reference.velocity - state.velocity)
        + vehicle.mass * GRAVITY * E3
        + vehicle.mass * reference.acceleration
    )
    b3 = force / np.linalg.norm(force)
    b2 = np.cross(b3, [np.cos(reference.yaw), np.sin(reference.yaw), 0.0])
    b2 /= np.linalg.norm(b2)
    R_d = np.column_stack([np.cross(b2, b3), b2, b3])
    R = RotationMatrix(Quaternion(state.quaternion)).matrix()
    e_R = 0.5 * vee(R_d.T @ R - R.T @ R_d)
    w = R.T @ state.angular_velocity
    moment = -k.attitude * e_R - k.angular_velocity * w + np.cross(w, J @ w)
    return np.array([force @ R @ E3, *moment])


@both_drones
@given(vectors, vectors, vectors, headings, rotations, vectors)
def test_with_the_originals_settings_it_is_the_papers(drone, p, v, a, yaw, q, w):
    """In any attitude, while the rotors can give the force: for the rest see limited()."""
    reference = Reference(p, v, 3 * a, REST, REST, yaw, 0.0, 0.0)
    state = State(0.0, q, -p / 2, 10 * w, -v / 2)
    expected = papers_wrench(VEHICLES[drone], reference, state)
    expected[0] = max(expected[0], 0.0)  # rotors push upwards only
    found = lee_wrench(reference, state, ORIGINAL[drone])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@both_drones
@given(vectors, vectors, headings, vectors, vectors, rotations, vectors)
def test_the_feed_forward_is_the_papers(drone, a, j, yaw, s, rates, q, w):
    """Equation (16) whole; w_d and its derivative are here found by differences of R_d."""
    vehicle = VEHICLES[drone]
    k, J = vehicle.original_gains, np.diag(vehicle.inertia)

    def attitude(t):
        """R_d some time later (s), if no error moves it."""
        force = a + t * j + t**2 / 2 * s + GRAVITY * E3
        b3 = force / np.linalg.norm(force)
        psi = yaw + t * rates[0] + t**2 / 2 * rates[1]
        b2 = np.cross(b3, [np.cos(psi), np.sin(psi), 0.0])
        b2 /= np.linalg.norm(b2)
        return np.column_stack([np.cross(b2, b3), b2, b3])

    h = 1e-3
    before, R_d, after = (attitude(t) for t in (-h, 0.0, h))
    w_d = vee(R_d.T @ (after - before) / (2 * h))
    dd = R_d.T @ (after - 2 * R_d + before) / h**2
    dw_d = vee((dd - dd.T) / 2)
    R = RotationMatrix(Quaternion(q)).matrix()
    w_B = R.T @ w
    e_R = 0.5 * vee(R_d.T @ R - R.T @ R_d)
    e_w = w_B - R.T @ R_d @ w_d
    moment = (
        -k.attitude * e_R
        - k.angular_velocity * e_w
        + np.cross(w_B, J @ w_B)
        - J @ (hat(w_B) @ R.T @ R_d @ w_d - R.T @ R_d @ dw_d)
    )
    reference = Reference(REST, REST, a, j, s, yaw, rates[0], rates[1])
    found = lee_wrench(reference, State(0.0, q, REST, w, REST), ORIGINAL[drone])
    np.testing.assert_allclose(found[1:], moment, atol=1e-5)


def test_the_originals_gains():
    found = {name: dc.astuple(vehicle.original_gains) for name, vehicle in VEHICLES.items()}
    assert found == {"Default": (1.6, 1.6, 3.0, 0.5), "StarOne": (2.0, 1.8, 2.8, 0.5)}


def test_a_vehicle_without_the_originals_gains():
    mine = dc.replace(VEHICLES["Default"], name="Mine", original_gains=None)
    make_parameters(mine, "lee", "vehicle")
    with pytest.raises(UserError, match="needs original_gains in the vehicle.yaml of Mine; add"):
        make_parameters(mine, "lee", "original")


def hover_eigenvalues(vehicle: Vehicle, attitude_error: str, gains: str, lag: float) -> np.ndarray:
    """Returns the eigenvalues of a vehicle that hovers under the control law, (n,) 1/s.

    The state is position, velocity, rotation vector and angular velocity, and with a lag of the
    rotors (s) also their wrench, which follows what is asked for; derivatives by differences.
    """
    parameters = make_parameters(vehicle, attitude_error, gains)
    m, J = vehicle.mass, np.array(vehicle.inertia)
    reference = Reference(REST, REST, REST, REST, REST, 0.0, 0.0, 0.0)

    def rates(x):
        p, v, theta, w, given = x[:3], x[3:6], x[6:9], x[9:12], x[12:]
        angle = max(np.linalg.norm(theta), 1e-300)
        R = RotationMatrix(AngleAxis(angle, theta / angle if theta.any() else E3))
        state = State(0.0, R.ToQuaternion().wxyz(), p, R @ w, v)
        asked = lee_wrench(reference, state, parameters)
        wrench = given if lag else asked
        acceleration = R.matrix()[:, 2] * wrench[0] / m - GRAVITY * E3
        turning = (wrench[1:] - np.cross(w, J * w)) / J
        return np.concatenate([v, acceleration, w, turning, (asked - given) / lag if lag else []])

    hover = np.concatenate([np.zeros(12), [m * GRAVITY, 0.0, 0.0, 0.0] if lag else []])
    steps = 1e-6 * np.eye(len(hover))
    return np.linalg.eigvals(
        np.column_stack([(rates(hover + h) - rates(hover - h)) / 2e-6 for h in steps])
    )


@both_drones
@pytest.mark.parametrize("attitude_error", ["reduced", "lee"])
def test_a_hover_is_stable_with_the_originals_gains(drone, attitude_error):
    """On the shipped drones, whose inertia is that of their size; also with their rotors' lag."""
    vehicle = VEHICLES[drone]
    for lag in (0.0, vehicle.rotor_lag):
        assert hover_eigenvalues(vehicle, attitude_error, "original", lag).real.max() < -0.1


def routh(vehicle: Vehicle, J: float) -> float:
    """Returns what is positive for a stable hover by original_gains, see OriginalGains."""
    k, m = vehicle.original_gains, vehicle.mass
    return (
        k.attitude * k.velocity * (k.angular_velocity - J * k.velocity / m)
        - k.angular_velocity**2 * k.position
    )


@settings(max_examples=30)
@both_drones
@given(st.floats(0.005, 1.5))
def test_rouths_criterion_tells_which_inertia_is_too_large(drone, J):
    vehicle = dc.replace(VEHICLES[drone], inertia=[J, J, J])
    eigenvalues = hover_eigenvalues(vehicle, "lee", "original", 0.0)
    k, m = vehicle.original_gains, vehicle.mass
    polynomial = [J, k.angular_velocity, k.attitude, k.attitude * k.velocity / m]
    polynomial.append(k.attitude * k.position / m)
    for root in np.roots(polynomial):
        assert np.abs(eigenvalues - root).min() < 1e-3 * abs(root)
    margin = routh(vehicle, J)
    assume(abs(margin) > 0.01)
    assert (eigenvalues.real.max() < 0.0) == (margin > 0.0)


def test_the_originals_inertia_would_not_be_stable():
    """1 kg m^2 about every axis, for the drone of 1 kg."""
    default = VEHICLES["Default"]
    heavy = dc.replace(default, inertia=[1.0, 1.0, 1.0])
    assert routh(default, 0.26) > 0.0 > routh(default, 0.261) > routh(default, 1.0)
    assert hover_eigenvalues(heavy, "lee", "original", 0.0).real.max() > 0.1


@given(st.tuples(numbers, numbers, numbers).map(lambda f: 50 * np.array(f)), st.floats(5.0, 30.0))
def test_height_goes_first(force, greatest):
    result = limited(force, greatest)
    assert np.linalg.norm(result) <= greatest + 1e-9
    assert result[2] == pytest.approx(min(max(force[2], 0.2 * GRAVITY), greatest))
    # To the side in the direction that was wanted, and as far as there is room.
    assert result[0] * force[1] == pytest.approx(result[1] * force[0], abs=1e-6)
    assert result[:2] @ force[:2] >= 0.0
    side, wanted = np.hypot(*result[:2]), np.hypot(*force[:2])
    room = np.sqrt(max(greatest**2 - result[2] ** 2, 0.0))
    assert side == pytest.approx(min(wanted, room), abs=1e-6)
