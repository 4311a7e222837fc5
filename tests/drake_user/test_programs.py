"""Programs of the planner in the user's hands, and planners of the user's own."""

import numpy as np
from pydrake.solvers import MathematicalProgram
from pydrake.trajectories import PiecewisePolynomial

from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.lap_planning import plan_lap
from airrace.track import load_track
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.min_snap import solve_min_snap
from airrace.trajopt.time_optimal.lap_samples import Grid
from airrace.trajopt.time_optimal.lap_search import LapSearch
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.vehicle import load_vehicle
from tests.drake_user.flights import OwnRace, on_a_map

TRACK = load_track("hexagon")
SOLVED = []


def solve(problem):
    """A planner of one's own, which asks ours."""
    SOLVED.append(problem)
    return plan_lap(problem)


def make(scenario):
    """The planner's system, of a scenario."""
    return LapPlanner.from_scenario(scenario, solve=solve)


def test_a_planner_of_ones_own():
    SOLVED.clear()
    race = OwnRace(on_a_map(systems={"lap_planner": f"{__name__}:make"}))
    race.simulator.AdvanceTo(6.0)
    assert len(SOLVED) == 1 and len(SOLVED[0].gates) == len(TRACK.gates)
    assert not race.value("truth.referee_status").over


def test_minimum_snap_is_drakes():
    """Its result is one of Drake's trajectories."""
    path = solve_min_snap(np.array([[0.0], [1.0], [0.0], [2.0]]), [0.5, 0.5, 1.0])
    assert isinstance(path, PiecewisePolynomial)
    assert path.derivative(1).end_time() == path.end_time() == 2.0


def test_a_step_to_the_quickest_lap():
    """Its program is open, too: here a gate must be crossed in its middle."""
    vehicle, _ = load_vehicle("Default")
    midpoints = np.array([gate.p_WG for gate in TRACK.gates])
    headings = np.array([gate.heading for gate in TRACK.gates])
    gates = GateRegions.windows(midpoints, headings, 4.0, 2.0)
    limits = FlightLimits(vehicle, max_speed=20.0, max_acceleration=10.0)
    constraints = FlightConstraints(TRACK.pylons()[:, :2], clearance=0.5, limits=limits)
    circuit = plan_optimal_circuit(gates, constraints)
    search = LapSearch(gates, gates.turn, constraints, Grid(circuit.spline.pieces, 18))
    now = search.settled(circuit.spline)
    crossing = now.lap.gates[2, 0, :3]
    assert np.linalg.norm(crossing - midpoints[2]) > 0.5  # it cuts the corner
    step = search.program(now, weight=0.02)
    assert isinstance(step.program, MathematicalProgram)
    change, unit = step.at_gate(2, 0)
    assert unit == 1.0
    middle = midpoints[2] - crossing
    step.program.AddBoundingBoxConstraint(middle, middle, change)
    lap = step.solve()
    np.testing.assert_allclose(lap.gates[2, 0, :3], midpoints[2], atol=1e-4)
    assert lap.duration > 0.98 * now.lap.duration
