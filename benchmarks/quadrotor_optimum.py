"""The quickest flight of a whole quadrotor: direct multiple shooting, solved by IPOPT.

Where the planner has a spline in the flat outputs, this has the equations of motion, with
position, velocity, attitude and angular velocity as states and the thrust of each rotor as
inputs, and leaves all to a solver of large nonlinear programs:

- Each leg, from gate to gate, is cut into intervals of the same duration; the legs' durations are
  variables, and their sum is the cost.
- States at the ends of intervals are variables. Over an interval a thrust goes in a straight line
  between two values, which are variables, and may jump where the next one begins.
- What Runge and Kutta's method of fourth order makes of one state is the next one.

Thrusts keep their limits at all times, the path its clearance at four points of an interval, and
everything else its own at the ends of intervals. Bock and Plitt, "A
multiple shooting algorithm for direct solution of optimal control problems" (IFAC 1984); for
quadrotors Foehn, Romero and Scaramuzza, "Time-optimal planning for quadrotor waypoint flight"
(Science Robotics 2021). CasADi differentiates: Andersson and others, "CasADi: a software framework
for nonlinear optimization and optimal control" (Math. Prog. Comp. 2019).
"""

import time
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from airrace.common.errors import UserError
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.flatness import (
    attitude_from_force,
    heading_vectors,
    inverse_dynamics,
    thrust_vectors,
)
from airrace.trajopt.flight_limits import FlightConstraints
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.optimal_course import CourseFlight
from airrace.vehicle import GRAVITY, Vehicle

_STEPS = 2  # of Runge and Kutta's method, in an interval
# Of the states: position, velocity, quaternion, angular velocity.
_P, _V, _Q, _W = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
_SCALE = np.repeat([10.0, 10.0, 1.0, 10.0], [3, 3, 4, 3])  # m, m/s, 1, rad/s
_NEAR = 6.0  # m beyond the clearance: pylons that are farther in the guess are left out
_PARTS = 4  # of an interval, for what the path keeps clear of
_OPTIONS = {
    "print_time": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 400,
        "tol": 1e-6,
        "mu_init": 1e-3,
        "bound_push": 1e-4,
        "bound_frac": 1e-4,
    },
}


class Flight(NamedTuple):
    """A flight through n gates, of as many intervals from each to the next."""

    durations: np.ndarray  #: of the legs, (legs,) s
    #: At the ends of intervals: p_WB (m), v_WB (m/s), quaternion of R_WB [w, x, y, z] without
    #: jumps, w_WB in B (rad/s), (13, legs * intervals + 1).
    states: np.ndarray
    #: At the start and at the end of every interval (N), (2, rotors, legs * intervals).
    thrusts: np.ndarray

    @property
    def duration(self) -> float:
        """In all (s)."""
        return float(self.durations.sum())

    def refined(self, factor: int) -> "Flight":
        """Returns nearly the same flight with so many intervals for each."""
        count = self.thrusts.shape[2]
        old, new = np.arange(count + 1), np.arange(factor * count + 1) / factor
        states = np.array([np.interp(new, old, row) for row in self.states])
        ends = np.arange(factor + 1) / factor
        first, last = self.thrusts[..., None]
        along = first + (last - first) * ends  # (rotors, intervals, factor + 1)
        parts = along[..., :-1], along[..., 1:]
        thrusts = np.array([part.reshape(len(first), -1) for part in parts])
        return Flight(self.durations, states, thrusts)


class Optimum(NamedTuple):
    """What the solver found."""

    flight: Flight
    converged: bool
    iterations: int
    cpu: float  #: s


def require_casadi() -> Any:
    """Returns the module; raises UserError if it, which an extra installs, is not there."""
    try:
        import casadi
    except ImportError:
        raise UserError(
            "The optimum is searched for with CasADi, which is missing: install it with "
            "`pip install 'airrace[benchmarks]'`, or `pip install casadi`."
        ) from None
    return casadi


def flight_of_lap(lap: FlatTrajectory, gate_times: np.ndarray, vehicle: Vehicle, intervals: int):
    """Returns a planned lap as a Flight.

    Args:
        lap: from its first gate on.
        gate_times: when gates are passed, then the duration (s).
        vehicle: that flies it.
        intervals: of each leg.
    """
    fractions = np.arange(intervals) / intervals
    durations = np.diff(gate_times)
    starts = np.asarray(gate_times)[:-1, None]
    times = np.append(starts + durations[:, None] * fractions, gate_times[-1])
    samples = lap.sample(times)
    r = as_reference(samples)
    axes, *_ = attitude_from_force(
        *thrust_vectors(samples),
        heading_vectors(np.cos(r.yaw), np.sin(r.yaw), r.yaw_rate, r.yaw_acceleration),
    )
    thrusts, w = inverse_dynamics(samples, vehicle)
    states = np.vstack([r.position, r.velocity, quaternions(np.stack(axes, axis=1)), w])
    return Flight(durations, states, np.array([thrusts[:, :-1], thrusts[:, 1:]]))


def flight_of_course(course: CourseFlight, intervals: int) -> Flight:
    """Returns a planned course as a Flight of so many intervals a leg."""
    at = course.states(intervals)
    quaternion = quaternions(at.rotations)
    states = np.vstack([at.positions, at.velocities, quaternion, at.angular_velocities])
    return Flight(
        course.spline.durations, states, np.array([at.thrusts[:, :-1], at.thrusts[:, 1:]])
    )


def quaternions(R_WB: np.ndarray) -> np.ndarray:
    """Returns [w, x, y, z] of rotations (3, 3, N) without jumps of the sign, (4, N)."""
    q = Rotation.from_matrix(np.moveaxis(R_WB, 2, 0)).as_quat(scalar_first=True)
    signs = np.cumprod(np.append(1.0, np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)))
    return (q * signs[:, None]).T


def optimum(
    guess: Flight, gates: GateRegions, constraints: FlightConstraints, drag: float = 0.0
) -> Optimum:
    """Returns the quickest flight near a guess.

    Args:
        guess: a lap, whose first gate is its last one; or an open flight, whose ends are kept.
        gates: to pass; of an open flight with both ends.
        constraints: to keep, but for the camera's view.
        drag: share of the vehicle's drag that acts, in still air.
    """
    ca = require_casadi()
    program = _Program(ca, guess, constraints, drag)
    if gates.is_closed:
        program.close()
    else:
        program.hold_ends()
    for gate in range(len(gates.midpoints)):
        if gate not in gates.ends:
            program.pass_gate(gate, gates)
    program.keep_limits()
    program.keep_clear()
    return program.solve()


class _Program:
    """The nonlinear program: variables in units of _SCALE and of the rotors' limits."""

    def __init__(self, ca, guess: Flight, constraints: FlightConstraints, drag: float):
        self._ca, self._guess, self._constraints = ca, guess, constraints
        self._limits, self._vehicle = constraints.limits, constraints.limits.vehicle
        self._legs, self._count = len(guess.durations), guess.thrusts.shape[2]
        self._each = self._count // self._legs
        rotors = len(self._vehicle.rotors)
        self._T = ca.MX.sym("T", self._legs)
        self._X = ca.MX.sym("X", 13, self._count + 1)
        self._U = [ca.MX.sym(name, rotors, self._count) for name in ("U0", "U1")]
        self._states = ca.diag(ca.DM(_SCALE)) @ self._X
        self._thrusts = [ca.diag(ca.DM(self._vehicle.max_thrusts)) @ U for U in self._U]
        self._g, self._low, self._high = [], [], []
        self._motion = self._make_motion(drag)
        steps = ca.repmat((self._T / self._each).T, self._each, 1)
        self._steps = ca.reshape(steps, 1, -1)
        next_state = self._make_step().map(self._count)
        found = next_state(self._states[:, :-1], *self._thrusts, self._steps)
        self._add(
            (self._states[:, 1:] - found) / ca.repmat(ca.DM(_SCALE), 1, self._count), 0.0, 0.0
        )

    def _add(self, expression, low, high):
        """Adds low <= expression <= high, numbers or arrays of its size."""
        flat = self._ca.vec(expression)
        self._g.append(flat)
        for bounds, value in ((self._low, low), (self._high, high)):
            bounds.append(np.broadcast_to(np.ravel(value, order="F"), flat.shape[0]))

    def _make_motion(self, drag):
        """Returns the function from state and thrusts to the state's derivative."""
        ca, vehicle = self._ca, self._vehicle
        x, u = ca.SX.sym("x", 13), ca.SX.sym("u", len(vehicle.rotors))
        v, q, w = x[_V], x[_Q], x[_W]
        wrench = ca.DM(vehicle.allocation) @ u
        R = _rotation(ca, q)
        linear, quadratic, angular = (
            ca.DM(drag * np.array(c))
            for c in (vehicle.drag.linear, vehicle.drag.quadratic, vehicle.drag.angular)
        )
        v_B = R.T @ v
        force = ca.vertcat(0.0, 0.0, wrench[0])
        force -= (linear + quadratic * ca.sqrt(ca.dot(v, v) + 1e-6)) * v_B
        J = ca.DM(vehicle.inertia)
        moment = wrench[1:] - angular * w - ca.cross(w, J * w)
        acceleration = R @ force / vehicle.mass - ca.vertcat(0.0, 0.0, GRAVITY)
        turn = 0.5 * ca.vertcat(-ca.dot(q[1:], w), q[0] * w + ca.cross(q[1:], w))
        return ca.Function("motion", [x, u], [ca.vertcat(v, acceleration, turn, moment / J)])

    def _make_step(self):
        """Returns the function from a state, thrusts and the interval's duration to the next."""
        ca = self._ca
        x, h = ca.SX.sym("x", 13), ca.SX.sym("h")
        first, last = (ca.SX.sym(name, len(self._vehicle.rotors)) for name in ("first", "last"))
        dt, now = h / _STEPS, x
        for i in range(_STEPS):
            u = [first + (last - first) * ((i + part) / _STEPS) for part in (0.0, 0.5, 1.0)]
            k1 = self._motion(now, u[0])
            k2 = self._motion(now + dt / 2 * k1, u[1])
            k3 = self._motion(now + dt / 2 * k2, u[1])
            k4 = self._motion(now + dt * k3, u[2])
            now = now + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            now[_Q] = now[_Q] / ca.norm_2(now[_Q])
        return ca.Function("step", [x, first, last, h], [now])

    def close(self):
        """Makes the last state the first; the quaternion's sign may be another one."""
        ca, states = self._ca, self._guess.states
        sign = np.ones(13)
        sign[_Q] = np.sign(states[_Q, 0] @ states[_Q, -1])
        self._add(self._X[:, 0] - ca.DM(sign) * self._X[:, -1], 0.0, 0.0)

    def hold_ends(self):
        """Keeps both ends as they are in the guess; any heading does at the last."""
        start, end = self._guess.states[:, 0], self._guess.states[:, -1]
        self._add(self._X[:, 0], start / _SCALE, start / _SCALE)
        others = [*range(_Q.start), *range(_W.start, _W.stop)]
        self._add(self._X[others, -1], (end / _SCALE)[others], (end / _SCALE)[others])
        # Upright, whatever the heading.
        self._add(self._X[7:9, -1], 0.0, 0.0)

    def pass_gate(self, i: int, gates: GateRegions):
        """Adds that a gate is passed where and whither it should be."""
        ca, state, region = self._ca, self._states[:, i * self._each], gates.regions[i]
        offset = state[_P] - ca.DM(region.midpoint)
        if len(region.A):
            self._add(ca.DM(region.A) @ offset, region.low, region.high)
        if np.isfinite(region.radius):
            self._add(ca.dot(offset, offset), -np.inf, region.radius**2)
        if gates.most_off < np.pi:
            v = state[_V]
            speed = ca.sqrt(ca.dot(v, v) + 1e-6)
            along = ca.dot(v, ca.DM(gates.forward[i])) - np.cos(gates.most_off) * speed
            self._add(along, 0.0, np.inf)

    def keep_limits(self):
        """Adds what FlightLimits has beside the rotors' thrusts, which are bounds."""
        ca, limits = self._ca, self._limits
        v, w = self._states[_V, :], self._states[_W, :]
        if np.isfinite(limits.max_speed):
            self._add(ca.sum1(v**2) / limits.max_speed**2, -np.inf, 1.0)
        if np.isfinite(limits.max_rate):
            self._add(ca.sum1(w**2) / limits.max_rate**2, -np.inf, 1.0)
        most = np.array(limits.max_axis_rates)
        if np.isfinite(most).any():
            self._add(w, *(np.tile(sign * most[:, None], w.shape[1]) for sign in (-1.0, 1.0)))
        motion = self._motion.map(self._count)
        for states, thrusts in zip((self._states[:, :-1], self._states[:, 1:]), self._thrusts):
            acceleration = motion(states, thrusts)[_V, :]
            if np.isfinite(limits.max_acceleration):
                most = limits.max_acceleration**2
                self._add(ca.sum1(acceleration**2) / most, -np.inf, 1.0)
            if np.isfinite(limits.min_lift):
                q = states[_Q, :]
                upright = 1.0 - 2.0 * (q[1, :] ** 2 + q[2, :] ** 2)
                lift = upright * ca.sum1(thrusts) / self._vehicle.mass
                self._add(lift / GRAVITY, limits.min_lift / GRAVITY, np.inf)

    def keep_clear(self):
        """Adds the clearance from pylons, and the least height, along the path between states."""
        ca, axes = self._ca, np.reshape(self._constraints.pylons, (-1, 2))
        clearances = np.broadcast_to(self._constraints.clearance, len(axes))
        steps = self._steps
        for x in np.arange(_PARTS) / _PARTS:
            # Hermite's cubic interpolants of position and velocity.
            weights = 1.0 + x**2 * (2.0 * x - 3.0), x * (x - 1.0) ** 2, x**2 * (x - 1.0)
            now, then = self._states[:, :-1], self._states[:, 1:]
            place = weights[0] * now[_P, :] + (1.0 - weights[0]) * then[_P, :]
            moved = weights[1] * now[_V, :] + weights[2] * then[_V, :]
            place += ca.repmat(steps, 3, 1) * moved
            self._add(place[2, :], self._constraints.min_height, np.inf)
            guessed = self._guess.states[:2, :-1]
            for axis, clearance in zip(axes, clearances):
                distance = np.linalg.norm(guessed - axis[:, None], axis=0)
                near = [int(k) for k in np.flatnonzero(distance < clearance + _NEAR)]
                if near:
                    offset = place[:2, near] - ca.repmat(ca.DM(axis), 1, len(near))
                    self._add(ca.sum1(offset**2), clearance**2, np.inf)

    def solve(self) -> Optimum:
        """Returns the solution."""
        ca, guess, limits = self._ca, self._guess, self._limits
        most = self._vehicle.max_thrusts[:, None]
        low, high = limits.idle_share, limits.thrust_share
        x = ca.vertcat(self._T, ca.vec(self._X), *(ca.vec(U) for U in self._U))
        shares = np.clip(guess.thrusts / most, low, high)
        start = [guess.durations, (guess.states / _SCALE[:, None]).ravel("F")]
        start += [each.ravel("F") for each in shares]
        sizes = [each.size for each in start]
        program = {"f": ca.sum1(self._T), "x": x, "g": ca.vertcat(*self._g)}
        clock = time.process_time()
        solver = ca.nlpsol("optimum", "ipopt", program, _OPTIONS)
        result = solver(
            x0=np.concatenate(start),
            lbx=np.repeat([1e-2, -np.inf, low, low], sizes),
            ubx=np.repeat([np.inf, np.inf, high, high], sizes),
            lbg=np.concatenate(self._low),
            ubg=np.concatenate(self._high),
        )
        cpu, stats = time.process_time() - clock, solver.stats()
        T, X, *U = np.split(np.array(result["x"]).ravel(), np.cumsum(sizes)[:-1])
        states = X.reshape(guess.states.shape, order="F") * _SCALE[:, None]
        thrusts = np.array([each.reshape(most.size, -1, order="F") * most for each in U])
        found = Flight(T, states, thrusts)
        return Optimum(found, bool(stats["success"]), int(stats["iter_count"]), cpu)


def _rotation(ca, q):
    """Returns R of a quaternion [w, x, y, z] of any length."""
    w, x, y, z = ca.vertsplit(q / ca.norm_2(q))
    return ca.vertcat(
        ca.horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        ca.horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        ca.horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
