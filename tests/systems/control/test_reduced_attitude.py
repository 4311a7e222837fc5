"""Coming down in a spin: its trim is an equilibrium, and the control turns with the world."""

import dataclasses as dc
import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RotationMatrix

from airrace.systems.control.attitude_error import lead_moment
from airrace.systems.control.reduced_attitude import ROTOR_DELAY, ReducedAttitude
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.rotor_loss import Remaining

DEFAULT, STAR_ONE = (load_vehicle(name)[0] for name in ("Default", "StarOne"))
WEIGHT = DEFAULT.mass * GRAVITY
Z = np.array([0.0, 0.0, 1.0])
CALM = np.zeros(3)
SINKING = (0.0, 0.0, -0.5)  # m/s, as it should
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
rotations = (
    st.tuples(*[numbers] * 4)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: RotationMatrix(Quaternion(q / np.linalg.norm(q))))
)
spins = st.floats(15.0, 50.0) | st.floats(-50.0, -15.0)


def without(vehicle, *lost):
    return Remaining(vehicle, [i not in lost for i in range(len(vehicle.rotors))])


LEFT = [without(DEFAULT, i) for i in range(4)]


def estimate(R, w=(0, 0, 0), v=SINKING):
    """Args: w: in the world."""
    return np.concatenate([[0.0], R.ToQuaternion().wxyz(), (0, 0, 5), w, v]).astype(float)


def upright(axis):
    """Returns a rotation that takes an axis of the body to the vertical."""
    n = np.cross(axis, Z)
    angle = np.arctan2(np.linalg.norm(n), axis @ Z)
    return RotationMatrix(AngleAxis(angle, n / np.linalg.norm(n)))


@pytest.mark.parametrize("lost", range(4))
@given(spins)
def test_the_trim_is_an_equilibrium(lost, spin):
    """Gyroscopic moments and thrusts cancel, and every rotor left has room to go down."""
    left, reduced = LEFT[lost], ReducedAttitude(DEFAULT)
    axis = reduced.spin_axis(spin, left)
    assert np.linalg.norm(axis) == pytest.approx(1.0)
    w = axis * spin / axis[2]
    J = np.array(DEFAULT.inertia)
    R = upright(axis)
    wrench = reduced.wrench(estimate(R, R.matrix() @ w), CALM, left)
    np.testing.assert_allclose(wrench[1:], np.cross(w, J * w), atol=1e-9)
    thrusts = left.allocator.allocate(wrench)
    produced = DEFAULT.allocation @ thrusts
    np.testing.assert_allclose(produced[1:3], wrench[1:3], atol=1e-6)
    assert produced[0] * axis[2] == pytest.approx(WEIGHT, rel=1e-6)
    working = np.arange(4) != lost
    assert thrusts[working].min() > 0.2 * WEIGHT / 3 and thrusts[lost] == 0.0


@pytest.mark.parametrize("lost", range(4))
def test_it_leans_towards_the_rotor_opposite_the_lost(lost):
    axis = ReducedAttitude(DEFAULT).spin_axis(20.0, LEFT[lost])
    away = -np.array(DEFAULT.rotors[lost].position[:2])
    np.testing.assert_allclose(
        axis[:2] / np.linalg.norm(axis[:2]), away / np.linalg.norm(away), atol=1e-4
    )


@given(st.floats(-100.0, 100.0), st.sampled_from(LEFT))
def test_the_lean_is_limited_whatever_the_spin(spin, left):
    axis = ReducedAttitude(DEFAULT).spin_axis(spin, left)
    assert np.linalg.norm(axis) == pytest.approx(1.0)
    assert np.hypot(axis[0], axis[1]) <= 0.3 * axis[2] + 1e-9


def test_no_lean_where_level_can_be_held():
    for vehicle, lost in ((DEFAULT, ()), (STAR_ONE, (0,)), (STAR_ONE, (0, 2))):
        axis = ReducedAttitude(vehicle).spin_axis(20.0, without(vehicle, *lost))
        np.testing.assert_array_equal(axis, Z)


@given(rotations, vectors, vectors, vectors, st.floats(-np.pi, np.pi), st.sampled_from(LEFT))
def test_it_turns_with_the_world(R, w, v, disturbance, angle, left):
    """There is no heading to hold: turned about the vertical, the wrench is the same."""
    reduced = ReducedAttitude(DEFAULT)
    T = RotationMatrix.MakeZRotation(angle)
    up = R.matrix()[2]
    assume(up @ reduced.spin_axis((20 * w) @ R.matrix()[:, 2], left) > -0.99)
    one = reduced.wrench(estimate(R, 20 * w, 10 * v), 5 * disturbance, left)
    other = reduced.wrench(estimate(T @ R, T @ (20 * w), T @ (10 * v)), T @ (5 * disturbance), left)
    np.testing.assert_allclose(other, one, atol=1e-6)


@given(st.floats(-np.pi, np.pi), st.floats(0.05, 3.0), st.sampled_from(LEFT))
def test_the_moment_rights_it(heading, tilt, left):
    """From rest, it turns the axis towards the vertical."""
    reduced = ReducedAttitude(DEFAULT)
    axis = reduced.spin_axis(0.0, left)
    across = np.array([np.cos(heading), np.sin(heading), 0.0])
    R = RotationMatrix(AngleAxis(tilt, across)) @ upright(axis)
    moment = reduced.wrench(estimate(R), CALM, left)[1:]
    acceleration = R.matrix() @ (moment / DEFAULT.inertia)
    gain = DEFAULT.gains.attitude
    np.testing.assert_allclose(acceleration, -2 * gain * np.sin(tilt / 2) * across, atol=1e-6)


@given(vectors, spins, st.sampled_from(LEFT))
def test_the_spin_does_not_turn_the_damping(w, spin, left):
    """Seen from axes that do not spin, what is beside the spin fades straight to zero."""
    reduced, J = ReducedAttitude(DEFAULT), np.array(DEFAULT.inertia)
    axis = reduced.spin_axis(spin, left)
    w = np.array([*(spin / axis[2] * axis + w)[:2], spin])
    along = w @ axis * axis
    beside = w - along
    R = upright(axis)
    trim = np.cross(along, J * along)
    moment = reduced.wrench(estimate(R, R.matrix() @ w), CALM, left)[1:]
    # What the rotors will have done, late.
    moment = trim + np.array(lead_moment(moment - trim, -ROTOR_DELAY * spin))
    acceleration = (moment - np.cross(w, J * w)) / J
    gain = DEFAULT.gains.angular_velocity
    np.testing.assert_allclose(acceleration + np.cross(along, beside), -gain * beside, atol=1e-5)


@given(st.floats(-5.0, 5.0), st.sampled_from(LEFT))
def test_thrust_brakes_to_the_sink_rate(vz, left):
    reduced = ReducedAttitude(DEFAULT)
    axis = reduced.spin_axis(30.0, left)
    R = upright(axis)
    lift = reduced.wrench(estimate(R, (0, 0, 30.0 / axis[2]), (0, 0, vz)), CALM, left)[0] * axis[2]
    assert np.sign(lift - WEIGHT) == np.sign(-0.5 - vz) or abs(vz + 0.5) < 1e-9
    assert lift >= 0.5 * WEIGHT - 1e-9


def test_it_leans_against_the_disturbance_and_the_drift():
    reduced = ReducedAttitude(STAR_ONE)
    left = without(STAR_ONE, 0, 5)  # holds level, but not the yaw
    assert left.can_hold_level and not left.can_fly
    level = RotationMatrix()
    for disturbance, v in (((2.0, 0, 0), SINKING), ((0, 0, 0), (1.0, 0.0, -0.5))):
        moment = reduced.wrench(estimate(level, v=v), np.array(disturbance), left)[1:]
        assert moment[1] < -0.1  # pitches up, back towards where it is pushed from
        assert abs(moment[0]) < 1e-9


BODIES = {
    "flat": [0.010, 0.011, 0.018],
    "tall": [0.018, 0.018, 0.010],
    "sphere": [0.010, 0.010, 0.010],
    "rod": [0.010, 0.018, 0.010],
}


@pytest.mark.parametrize("inertia", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("vehicle", [DEFAULT, STAR_ONE], ids=["Default", "StarOne"])
def test_whatever_is_lost_the_wrench_is_finite(vehicle, inertia):
    """Up to all rotors, for any shape of body, any spin, either way up."""
    vehicle = dc.replace(vehicle, inertia=inertia)
    reduced = ReducedAttitude(vehicle)
    n = len(vehicle.rotors)
    for count in {1, 2, n - 2, n - 1, n}:
        for lost in itertools.combinations(range(n), count):
            left = without(vehicle, *lost)
            for spin, R in ((0.0, np.diag([1.0, -1, -1])), (5.0, np.eye(3)), (-40.0, np.eye(3))):
                R = RotationMatrix(R)
                wrench = reduced.wrench(estimate(R, R.matrix() @ (spin * Z)), CALM, left)
                assert np.all(np.isfinite(wrench))
                assert np.linalg.norm(reduced.spin_axis(spin, left)) == pytest.approx(1.0)
                thrusts = left.allocator.allocate(wrench)
                assert np.all(thrusts >= 0.0) and np.all(thrusts <= left.max_thrusts)


def test_two_opposite_rotors_of_a_plus():
    """What is left has no moment about the axis between them at all."""
    plus = dc.replace(
        DEFAULT,
        rotors=[
            dc.replace(rotor, position=position)
            for rotor, position in zip(
                DEFAULT.rotors, [[0.2, 0, 0], [0, 0.2, 0], [-0.2, 0, 0], [0, -0.2, 0]]
            )
        ],
    )
    plus.check()
    for lost in ((0, 2), (1, 3), (0, 1, 2)):
        left = without(plus, *lost)
        assert not left.can_hold_level
        wrench = ReducedAttitude(plus).wrench(estimate(RotationMatrix()), CALM, left)
        assert np.all(np.isfinite(left.allocator.allocate(wrench)))
