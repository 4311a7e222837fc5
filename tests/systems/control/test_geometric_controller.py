"""The controller: inverse dynamics on the trajectory, and back to it from anywhere."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from airrace.math.vec3 import cross
from airrace.systems.control.attitude_error import lead_moment
from airrace.systems.control.control_law import lee_wrench, make_parameters
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.control.reduced_attitude import ROTOR_DELAY
from airrace.trajopt.flat_trajectory import hold, idle
from airrace.trajopt.flatness import attitude_from_force, heading_vectors, inverse_dynamics
from airrace.trajopt.reference import Reference, as_reference
from airrace.vehicle import GRAVITY, Rotor, Vehicle, load_vehicle
from airrace.vehicle.air import Air, air_vector, drag_acceleration
from airrace.vehicle.allocation import Allocator
from airrace.vehicle.state import as_state

RATE = 500.0
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
CONTROLLERS = {
    name: GeometricController(vehicle=vehicle, rate=RATE) for name, vehicle in VEHICLES.items()
}
both_drones = pytest.mark.parametrize("drone", VEHICLES)
P = np.array([0.0, 0.0, 5.0])
E1, REST = np.array([1.0, 0.0, 0.0]), np.zeros(3)
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
angles = st.floats(-1.0, 1.0)
headings = st.floats(-np.pi, np.pi)


def estimate(p=P, R=RotationMatrix(), w=(0, 0, 0), v=(0, 0, 0)):
    return np.concatenate([[0.0], R.ToQuaternion().wxyz(), p, w, v]).astype(float)


def hover_speeds(vehicle):
    thrusts = np.linalg.pinv(vehicle.allocation)[:, 0] * vehicle.mass * GRAVITY
    return np.sqrt(thrusts / vehicle.thrust_coefficients)


def tilted(angle, heading):
    """Returns a rotation by an angle about a horizontal axis."""
    return RotationMatrix(AngleAxis(angle, [np.cos(heading), np.sin(heading), 0.0]))


class Bench:
    """A controller whose inputs are fixed: at first, a hover at the reference."""

    def __init__(self, vehicle, **options):
        self.controller = GeometricController(vehicle=vehicle, **{"rate": RATE, **options})
        self.context = self.controller.CreateDefaultContext()
        n = len(vehicle.rotors)
        self.fix(
            reference=hold(P, 0.0),
            filtered_estimate=estimate(),
            disturbance=np.zeros(3),
            rotor_speeds=hover_speeds(vehicle),
            rotor_losses=np.full(n, np.inf),
        )

    def fix(self, **inputs):
        for name, value in inputs.items():
            self.controller.GetInputPort(name).FixValue(self.context, value)

    def update(self):
        """Ticks once, and returns the command."""
        update = self.controller.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.SetDiscreteState(0, update.value())
        return self.controller.GetOutputPort("rotor_speed_command").Eval(self.context)


@both_drones
def test_hovers_at_the_reference(drone):
    vehicle = VEHICLES[drone]
    wrench = CONTROLLERS[drone].calc_wrench(hold(P, 0.0), estimate())
    np.testing.assert_allclose(wrench, [vehicle.mass * GRAVITY, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(Bench(vehicle).update(), hover_speeds(vehicle), rtol=1e-9)


@both_drones
def test_asks_for_nothing_while_it_stands(drone):
    """Whatever the drone believes of itself, and leans against."""
    reference = idle(P, 0.0)
    as_reference(reference).acceleration[:] += 8.0
    tilted = RotationMatrix(RollPitchYaw(0.3, -0.2, 1.0))
    state = estimate(P + [0.1, 0.0, 1.0], tilted, v=[0.0, 1.0, 0.0], w=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(CONTROLLERS[drone].calc_wrench(reference, state), np.zeros(4))


@both_drones
@pytest.mark.parametrize("axis", range(3))
def test_pushes_against_errors(drone, axis):
    """Right of the target, roll left; ahead of it, pitch back; above, less thrust."""
    p = P.copy()
    p[axis] += 0.5
    f, mx, my, _ = CONTROLLERS[drone].calc_wrench(hold(P, 0.0), estimate(p))
    if axis == 0:
        assert my < 0
    elif axis == 1:
        assert mx > 0
    else:
        assert f < VEHICLES[drone].mass * GRAVITY


@both_drones
@given(angles, angles, headings)
def test_turns_back_to_level(drone, roll, pitch, yaw):
    """The moment does work against any attitude error."""
    R = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix()
    error = (RollPitchYaw(0, 0, yaw).ToRotationMatrix().inverse() @ R).ToAngleAxis()
    wrench = CONTROLLERS[drone].calc_wrench(hold(P, yaw), estimate(R=R))
    torque_along_error = wrench[1:] @ error.axis() * np.sign(error.angle())
    assert torque_along_error <= 1e-9
    if abs(error.angle()) > 1e-3:
        assert torque_along_error < 0


@both_drones
@given(headings, st.sampled_from([np.pi, np.pi - 1e-9, np.pi - 1e-3]), vectors)
def test_upside_down_it_rights_itself_with_all_its_might(drone, heading, angle, w):
    """The greatest moment of all attitudes is there, and the rotors are to give it."""
    vehicle, controller = VEHICLES[drone], CONTROLLERS[drone]
    still = estimate(R=tilted(angle, heading))
    wrench = controller.calc_wrench(hold(P, 0.0), still)
    acceleration = wrench[1:] / vehicle.inertia
    assert np.hypot(*acceleration[:2]) == pytest.approx(2 * vehicle.gains.attitude, rel=1e-5)
    assert wrench[0] == pytest.approx(0.0, abs=1e-6)  # no thrust towards the ground
    allocate = Allocator(vehicle.allocation, vehicle.max_thrusts).allocate
    produced = vehicle.allocation @ allocate(wrench)
    assert produced[1:3] @ wrench[1:3] > 0.5 * np.linalg.norm(wrench[1:3]) * np.linalg.norm(
        vehicle.allocation[1:3] @ np.where(wrench[1:3] @ vehicle.allocation[1:3] > 0, 8.5, 0.0)
    )


@both_drones
@given(headings, st.floats(0.0, 3.1), headings, st.floats(-10.0, 10.0))
def test_yaw_does_not_turn_the_correction_of_a_tilt_aside(drone, heading, tilt, yaw, spin):
    """Whatever the error in yaw; only the lead of a spinning body turns it."""
    calc = CONTROLLERS[drone].calc_wrench
    R = tilted(tilt, heading)
    alone = calc(hold(P, 0.0), estimate(R=R))[1:]
    R = RotationMatrix.MakeZRotation(yaw) @ R
    both = calc(hold(P, 0.0), estimate(R=R))[1:]
    np.testing.assert_allclose(both[:2], alone[:2], atol=1e-6)
    spinning = calc(hold(P, 0.0), estimate(R=R, w=spin * R.matrix()[:, 2]))[1:]
    # What is about z damps the spin besides.
    expected = lead_moment(alone, ROTOR_DELAY * spin)
    np.testing.assert_allclose(spinning[:2], expected[:2], atol=1e-6)


@both_drones
@given(vectors, vectors, vectors, headings, st.floats(-2, 2), st.floats(-2, 2))
def test_feed_forward_is_inverse_dynamics(drone, a, j, s, yaw, rate, acceleration):
    """On the trajectory, the controller commands what flatness says, and leads a spin."""
    vehicle = VEHICLES[drone]
    a, j, s = 5 * a, 8 * j, 8 * s
    reference = np.hstack(Reference(P, np.zeros(3), a, j, s, yaw, rate, acceleration))
    force = a + [0.0, 0.0, GRAVITY]
    axes, w, _ = attitude_from_force(
        force, j, s, heading_vectors(np.cos(yaw), np.sin(yaw), rate, acceleration)
    )
    R = RotationMatrix(np.array(axes).T)
    wrench = CONTROLLERS[drone].calc_wrench(reference, estimate(R=R, w=R.matrix() @ w))
    expected = vehicle.allocation @ inverse_dynamics(reference[:, None], vehicle)[0][:, 0]
    expected[1:] = lead_moment(expected[1:], ROTOR_DELAY * w[2])
    np.testing.assert_allclose(wrench, expected, atol=1e-8, rtol=1e-8)


@both_drones
@given(vectors, vectors, vectors, headings, headings, vectors)
def test_it_turns_with_the_world(drone, p, v, w, tilt, angle, a):
    """Turned about the vertical, reference and all, the wrench is the same."""
    calc = CONTROLLERS[drone].calc_wrench
    T = RotationMatrix.MakeZRotation(angle)
    R = tilted(0.9 * tilt, tilt)
    one, other = hold(P, 0.0), hold(T @ P, angle)
    as_reference(one).acceleration[:], as_reference(other).acceleration[:] = a, T @ a
    np.testing.assert_allclose(
        calc(other, estimate(T @ (P + p), T @ R, T @ (5 * w), T @ v)),
        calc(one, estimate(P + p, R, 5 * w, v)),
        atol=1e-6,
    )


@both_drones
@given(headings)
def test_far_away_it_leans_as_far_as_the_thrust_carries_it(drone, heading):
    """And no farther: most of the rotors' thrust holds the height."""
    vehicle = VEHICLES[drone]
    most = vehicle.max_thrusts.sum()
    lean = np.arccos(vehicle.mass * GRAVITY / most)
    R = tilted(lean, heading)
    p = P - 1e3 * np.array([R.matrix()[0, 2], R.matrix()[1, 2], 0.0])
    wrench = CONTROLLERS[drone].calc_wrench(hold(P, 0.0), estimate(p, R))
    assert wrench[0] == pytest.approx(most)
    np.testing.assert_allclose(wrench[1:3], 0.0, atol=1e-6)


@both_drones
@given(vectors, st.floats(-10.0, 10.0))
def test_a_spin_does_not_turn_the_damping_of_the_others(drone, w, spin):
    """Seen from axes that do not spin, rates about x and y fade straight to zero."""
    vehicle = VEHICLES[drone]
    w = np.array([w[0], w[1], spin])
    moment = CONTROLLERS[drone].calc_wrench(hold(P, 0.0), estimate(w=w))[1:]
    moment = lead_moment(moment, -ROTOR_DELAY * spin)  # what the rotors will have done
    J = np.array(vehicle.inertia)
    acceleration = (moment - np.cross(w, J * w)) / J
    across = np.array([w[0], w[1], 0.0])
    seen = acceleration + np.cross([0.0, 0.0, spin], across)
    np.testing.assert_allclose(seen[:2], -vehicle.gains.angular_velocity * across[:2], atol=1e-6)


@both_drones
def test_errors_in_yaw_take_no_more_than_the_rotors_have(drone):
    """At a hover; and they are damped as well as those of the tilt."""
    vehicle, calc = VEHICLES[drone], CONTROLLERS[drone].calc_wrench

    def moment(yaw, rate):
        R = RotationMatrix.MakeZRotation(yaw)
        return calc(hold(P, 0.0), estimate(R=R, w=(0, 0, rate)))

    thrusts = np.linalg.pinv(vehicle.allocation) @ moment(0.24, 0.0)
    assert np.all(thrusts >= 0.0) and np.all(thrusts <= vehicle.max_thrusts)
    k_R, k_w = -moment(1e-6, 0.0)[3] / 1e-6, -moment(0.0, 1e-6)[3] / 1e-6
    gains, J = vehicle.gains, vehicle.inertia[2]
    assert k_R / J < gains.attitude
    assert k_w / J / np.sqrt(k_R / J) == pytest.approx(
        gains.angular_velocity / np.sqrt(gains.attitude), rel=1e-4
    )


def test_commands_are_held_at_the_control_rate_and_within_limits():
    vehicle = VEHICLES["Default"]
    bench = Bench(vehicle)
    simulator = Simulator(bench.controller, bench.context)
    commands = []
    for k, p in enumerate([(0, 0, 5), (100, -100, -50), (0, 0, 200), (0, 0, 5)]):
        bench.fix(filtered_estimate=estimate(p))
        simulator.AdvanceTo((k + 0.5) / RATE)
        commands.append(bench.controller.get_output_port().Eval(bench.context).copy())
    commands = np.array(commands)
    assert np.all(commands >= 0) and np.all(commands <= vehicle.max_speeds)
    for command in commands[[0, 3]]:
        np.testing.assert_allclose(command, np.sqrt(GRAVITY / 4 / 1e-3))


@both_drones
@pytest.mark.parametrize("lag, seen", [(0.03, 0.01), (0.05, 0.01), (0.01, 0.01), (0.004, 0.004)])
def test_rotors_are_driven_to_look_faster(drone, lag, seen):
    """Over one period, one with a lag of 30 ms moves as if it had 10 ms."""
    vehicle = dc.replace(VEHICLES[drone], rotor_lag=lag)
    bench = Bench(vehicle)
    p = P + [0.01, -0.01, 0.02]
    bench.fix(filtered_estimate=estimate(p))
    speeds, command = hover_speeds(vehicle), bench.update()
    wrench = CONTROLLERS[drone].calc_wrench(hold(P, 0.0), estimate(p))
    desired = np.sqrt(np.linalg.pinv(vehicle.allocation) @ wrench / vehicle.thrust_coefficients)
    moved = (1 - np.exp(-1 / RATE / lag)) * (command - speeds)
    np.testing.assert_allclose(moved, (1 - np.exp(-1 / RATE / seen)) * (desired - speeds))


BAD = [np.nan, np.inf, -np.inf]


@both_drones
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    "port, size", [("filtered_estimate", 14), ("reference", 18), ("disturbance", 3)]
)
def test_what_is_not_finite_keeps_the_last_command(drone, port, size, bad):
    vehicle = VEHICLES[drone]
    bench = Bench(vehicle)
    bench.fix(filtered_estimate=estimate(P + 0.1, tilted(0.1, 0.3), (0.1, 0.2, 0.3)))
    last = bench.update().copy()
    good = np.array(bench.controller.GetInputPort(port).Eval(bench.context))
    # At rest at the target, nothing would be the same.
    bench.fix(filtered_estimate=estimate())
    for i in range(1 if port == "filtered_estimate" else 0, size):
        value = good.copy()
        value[i] = bad
        bench.fix(**{port: value})
        np.testing.assert_array_equal(bench.update(), last)


@pytest.mark.parametrize("bad", BAD)
def test_a_wrench_that_is_not_finite_keeps_the_last_command(bad):
    bench = Bench(VEHICLES["Default"])
    last = bench.update().copy()
    bench.controller.calc_wrench = lambda *_: np.array([9.81, 0.0, bad, 0.0])
    np.testing.assert_array_equal(bench.update(), last)


@pytest.mark.slow
@both_drones
@pytest.mark.parametrize("bad", BAD)
def test_a_rotor_that_reports_no_speed_is_not_driven(drone, bad):
    vehicle = VEHICLES[drone]
    bench = Bench(vehicle)
    speeds = hover_speeds(vehicle)
    speeds[1] = bad
    bench.fix(rotor_speeds=speeds)
    with np.errstate(invalid="ignore"):
        command = bench.update()
    assert np.all(command >= 0.0) and np.all(command <= vehicle.max_speeds)
    others = np.arange(len(speeds)) != 1
    np.testing.assert_allclose(command[others], speeds[others])


@both_drones
def test_it_leans_against_the_disturbance(drone):
    vehicle = VEHICLES[drone]
    push = np.array([0.3, -0.2, 0.4])
    lean = Bench(vehicle)
    lean.fix(disturbance=push)
    reference = hold(P, 0.0)
    as_reference(reference).acceleration[:] = -push
    planned = Bench(vehicle)
    planned.fix(reference=reference)
    np.testing.assert_allclose(lean.update(), planned.update(), rtol=1e-12)
    # Pushed ahead, to the right and up, it pitches back, rolls left and thrusts less.
    speeds = hover_speeds(vehicle)
    change = vehicle.allocation @ (lean.update() - speeds)
    assert change[0] < 0 and change[1] < 0 and change[2] < 0
    stubborn = Bench(vehicle, disturbance_rejection=False)
    stubborn.fix(disturbance=push)
    np.testing.assert_allclose(stubborn.update(), speeds, rtol=1e-9)


@both_drones
def test_rotors_that_are_known_to_be_weaker_are_driven_harder(drone):
    """So that the wrench stays what it was."""
    vehicle = VEHICLES[drone]
    factors = 1.0 - 0.02 * np.arange(len(vehicle.rotors))
    bench = Bench(vehicle, rotor_overdrive=False)
    bench.fix(rotor_factors=factors)
    thrusts = factors * vehicle.thrust_coefficients * bench.update() ** 2
    expected = [vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(vehicle.allocation @ thrusts, expected, atol=1e-9)


@both_drones
def test_it_turns_as_a_drag_that_is_known_changes(drone):
    air = Air(0.1, 0.01, np.array([1.0, 2.0, 0.0]))
    reference = hold(P, 0.0)
    as_reference(reference).velocity[:] = v = np.array([5.0, -3.0, 1.0])
    as_reference(reference).acceleration[:] = a = np.array([2.0, 1.0, 0.5])
    lean = Bench(VEHICLES[drone])
    lean.fix(reference=reference, air=air_vector(air))
    h = 1e-5
    drags = [drag_acceleration(v + t * a, np.zeros(3), air) for t in (-h, h)]
    as_reference(reference).jerk[:] = -(drags[1] - drags[0]) / (2 * h)
    planned = Bench(VEHICLES[drone])
    planned.fix(reference=reference)
    np.testing.assert_allclose(lean.update(), planned.update(), rtol=1e-6)


@both_drones
def test_without_feed_forward_the_desired_rates_are_zero(drone):
    reference = hold(P, 0.01)
    as_reference(reference).acceleration[:] = 0.1, -0.05, 0.2
    plain = Bench(VEHICLES[drone], feed_forward=False)
    plain.fix(reference=reference)
    expected = plain.update().copy()
    parts = as_reference(reference)
    for part in ("jerk", "snap", "yaw_rate", "yaw_acceleration"):
        busy = np.hstack(parts._replace(**{part: 0.7 + 0.0 * getattr(parts, part)}))
        plain.fix(reference=busy)
        np.testing.assert_array_equal(plain.update(), expected)
        whole = Bench(VEHICLES[drone])
        whole.fix(reference=busy)
        assert np.abs(whole.update() - expected).max() > 1e-6
    # What is left is as before.
    for part in ("position", "acceleration", "yaw"):
        busy = np.hstack(parts._replace(**{part: 0.01 + getattr(parts, part)}))
        plain.fix(reference=busy)
        assert np.abs(plain.update() - expected).max() > 1e-6


ORIGINAL = dict(  # the controller of the original system
    rate=800.0,
    feed_forward=False,
    disturbance_rejection=False,
    attitude_error="lee",
    gains="original",
    rotor_overdrive=False,
)


@both_drones
@given(vectors, vectors, vectors, vectors, headings)
def test_the_originals_rotors_are_to_give_the_papers_wrench(drone, p, v, w, a, yaw):
    """At once, whatever they do now, and without a look at what comes next."""
    vehicle = VEHICLES[drone]
    bench = Bench(vehicle, **ORIGINAL)
    R = RotationMatrix.MakeZRotation(yaw)
    where = estimate(P + p / 50, R, w / 50, v / 50)
    reference = Reference(P, REST, a / 50, 30 * w, 30 * v, yaw, 2.0, 3.0)
    bench.fix(
        reference=np.hstack(reference),
        filtered_estimate=where,
        disturbance=5 * a,
        rotor_speeds=0.5 * hover_speeds(vehicle),
    )
    thrusts = vehicle.thrust_coefficients * bench.update() ** 2
    calm = reference._replace(jerk=REST, snap=REST, yaw_rate=0.0, yaw_acceleration=0.0)
    wrench = lee_wrench(calm, as_state(where), make_parameters(vehicle, "lee", "original"))
    np.testing.assert_allclose(vehicle.allocation @ thrusts, wrench, atol=1e-9)


@both_drones
def test_each_part_of_the_originals_controller_is_one_of_its_own(drone):
    """Each setting changes the command by itself."""
    vehicle = VEHICLES[drone]
    commands = []
    for name in (None, *ORIGINAL):
        bench = Bench(vehicle, **({} if name is None else {name: ORIGINAL[name]}))
        reference = np.hstack(Reference(P, REST, REST, 9 * E1, 9 * E1, 0.3, 0.2, 0.2))
        bench.fix(reference=reference, filtered_estimate=estimate(P + E1, tilted(0.1, 0.0)))
        bench.fix(disturbance=0.1 * E1, rotor_speeds=0.9 * hover_speeds(vehicle))
        commands.append(tuple(bench.update()))
    assert len(set(commands)) == len(ORIGINAL) + 1


@st.composite
def losses(draw):
    drone = draw(st.sampled_from(list(VEHICLES)))
    return drone, draw(st.sets(st.integers(0, len(VEHICLES[drone].rotors) - 1), min_size=1))


@pytest.mark.slow
@given(losses(), vectors, headings, vectors, st.floats(0.0, 1.0))
def test_a_lost_rotor_is_not_driven(case, p, tilt, w, share):
    drone, lost = case
    vehicle = VEHICLES[drone]
    bench = Bench(vehicle)
    times = np.full(len(vehicle.rotors), np.inf)
    times[list(lost)] = 1.0
    bench.fix(
        rotor_losses=times,
        rotor_speeds=share * vehicle.max_speeds,
        filtered_estimate=estimate(P + 10 * p, tilted(tilt, tilt), 20 * w),
    )
    command = bench.update()
    assert np.all(command[list(lost)] == 0.0)
    assert np.all(command >= 0.0) and np.all(command <= vehicle.max_speeds)


@pytest.mark.parametrize("lost", range(8))
def test_the_star_one_flies_on_with_the_rest(lost):
    vehicle = VEHICLES["StarOne"]
    bench = Bench(vehicle)
    times = np.full(8, np.inf)
    times[lost] = 1.0
    p = P + [0.02, 0.01, -0.03]
    bench.fix(rotor_losses=times, filtered_estimate=estimate(p))
    wrench = CONTROLLERS["StarOne"].calc_wrench(hold(P, 0.0), estimate(p))
    speeds = hover_speeds(vehicle)
    for _ in range(200):
        speeds = speeds + (1 - np.exp(-1 / RATE / vehicle.rotor_lag)) * (bench.update() - speeds)
        bench.fix(rotor_speeds=speeds)
    thrusts = vehicle.thrust_coefficients * speeds**2
    np.testing.assert_allclose(vehicle.allocation @ thrusts, wrench, atol=1e-6)


def test_a_quadrotor_that_lost_a_rotor_forgets_the_reference():
    bench = Bench(VEHICLES["Default"])
    bench.fix(rotor_losses=[np.inf, 1.0, np.inf, np.inf], filtered_estimate=estimate(w=(0, 0, 9)))
    command = bench.update().copy()
    assert np.count_nonzero(command) == 3
    bench.fix(filtered_estimate=estimate(w=(1, 0, 9)))
    other = bench.update().copy()
    assert np.any(other != command)
    for reference in (hold([50, 0, 0], 1.0), np.full(18, np.nan)):
        bench.fix(reference=reference, filtered_estimate=estimate(w=(0, 0, 9)))
        np.testing.assert_array_equal(bench.update(), command)
        bench.fix(filtered_estimate=estimate(w=(1, 0, 9)))
        np.testing.assert_array_equal(bench.update(), other)


@st.composite
def hexacopters(draw):
    """Of any size, shape and motors, with the gains that every drone has."""

    def between(low, high):
        return draw(st.floats(low, high))

    mass, arm, start = between(0.3, 6.0), between(0.1, 0.5), between(0.0, 1.0)
    x, y, z = (between(0.02, 0.15) * mass * arm**2 for _ in range(3))
    angles = start + np.pi / 3 * np.arange(6)
    rotor = Rotor(
        thrust_coefficient=10.0 ** between(-6.0, -3.0),
        torque_ratio=between(0.005, 0.03),
        max_thrust=between(1.8, 4.0) * mass * GRAVITY / 6,
        radius=arm / 3,
    )
    vehicle = Vehicle(
        name="hexacopter",
        model="none",
        mass=mass,
        rotor_lag=between(0.01, 0.04),
        inertia=[y + z, x + z, x + y],  # of second moments, so that any will do
        rotors=[
            dc.replace(
                rotor,
                position=[arm * np.cos(a), arm * np.sin(a), between(-0.1, 0.1)],
                direction=("ccw", "cw")[i % 2],
            )
            for i, a in enumerate(angles)
        ],
    )
    vehicle.check()
    return vehicle


def fly(vehicle, R, seconds):
    """Flies a rigid body on lagged rotors; returns p_WB, R_WB, and w in B."""
    bench = Bench(vehicle)
    B, c_f, J = vehicle.allocation, vehicle.thrust_coefficients, np.array(vehicle.inertia)
    speeds, p, v, w = hover_speeds(vehicle), P.copy(), np.zeros(3), np.zeros(3)
    dt = 0.5 / RATE
    blend = 1 - np.exp(-dt / vehicle.rotor_lag)
    for _ in range(round(seconds * RATE)):
        bench.fix(filtered_estimate=estimate(p, R, R @ w, v), rotor_speeds=speeds)
        command = bench.update()
        for _ in range(2):
            speeds = speeds + blend * (command - speeds)
            wrench = B @ (c_f * speeds * speeds)
            w = w + dt * (wrench[1:] - cross(w, J * w)) / J
            q = np.array([1.0, *(dt / 2 * w)])
            R = R @ RotationMatrix(Quaternion(q / np.linalg.norm(q)))
            v = v + dt * (R.col(2) * wrench[0] / vehicle.mass - [0, 0, GRAVITY])
            p = p + dt * v
    return p, R, w


@pytest.mark.slow
@settings(max_examples=10)
@given(hexacopters(), headings)
def test_the_gains_suit_any_drone(vehicle, heading):
    """It recovers from 60 degrees, whatever its mass, inertia, arms and rotors."""
    p, R, w = fly(vehicle, tilted(np.pi / 3, heading), 3.0)
    assert np.degrees(np.arccos(R.matrix()[2, 2])) < 1.0
    assert np.linalg.norm(w[:2]) < 0.1
    np.testing.assert_allclose(p, P, atol=0.05)


@settings(max_examples=10)
@given(hexacopters())
def test_any_drone_stays_in_a_hover(vehicle):
    p, R, w = fly(vehicle, RotationMatrix(), 0.3)
    np.testing.assert_allclose(p, P, atol=1e-6)
    np.testing.assert_allclose(R.matrix(), np.eye(3), atol=1e-6)
    np.testing.assert_allclose(w, 0.0, atol=1e-6)
