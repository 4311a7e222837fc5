"""What an estimator knew in a race, beside the truth.

Truth and estimates are written down while the race is flown, without a file; figures() then
compares them. The body is B, the world W, the inertial sensor I.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.diagrams.race import run_race
from airrace.math.quaternion import rotation_between, rotation_matrix
from airrace.recording.race_events import GatesMoved, MapChanged
from airrace.scenario import Scenario
from airrace.systems.estimation.navigation import as_navigation
from airrace.track import load_track
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_state
from tests.worlds.logged_race import LoggedInProcess

_TRUTH_RATE, _ESTIMATE_RATE = 500.0, 100.0  # Hz
_AIRBORNE = 0.3  # m above the start
_NEES_SIZE = 9  # attitude, position and velocity


class GateMeasurement(NamedTuple):
    """What the estimator knew after a picture.

    Attributes:
        navigation: vector of Navigation, of the picture's time, (17,).
        covariance: of the errors of attitude, position and velocity, (9, 9).
        seen_at: time of the newest picture with a marker that counted (s), -1 for none.
    """

    navigation: np.ndarray
    covariance: np.ndarray
    seen_at: float


class EstimationLog(LeafSystem):
    """Writes down the truth and what the estimator says.

    .. pydrake_system::

        name: EstimationLog
        input_ports:
        - truth.state
        - filtered_estimate
        - slam_state (only of an autonomy that estimates)

    Nothing in the race depends on it.

    Attributes:
        truths, estimates: vectors of vehicle/state.py.
        sights: one a picture.
    """

    def __init__(self, fps: float, estimates: bool):
        """Args: fps: of the camera. estimates: whether there is a ``slam_state``."""
        LeafSystem.__init__(self)
        self.truths, self.estimates, self.sights = [], [], []
        self._state = self.DeclareVectorInputPort("truth.state", STATE_SIZE - 1)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self.DeclarePeriodicPublishEvent(1.0 / _TRUTH_RATE, 0.0, self._write_truth)
        self.DeclarePeriodicPublishEvent(1.0 / _ESTIMATE_RATE, 0.0, self._write_estimate)
        if estimates:
            self._slam = self.DeclareAbstractInputPort("slam_state", Value[object]())
            self.DeclarePeriodicPublishEvent(1.0 / fps, 0.0, self._write_sight)

    def _write_truth(self, context):
        self.truths.append(np.array([context.get_time(), *self._state.Eval(context)]))

    def _write_estimate(self, context):
        self.estimates.append(self._estimate.Eval(context))

    def _write_sight(self, context):
        slam = self._slam.Eval(context)
        if slam.time >= 0.0 and slam.image_time == slam.time and not slam.at_rest:
            seen_at = max((each.seen_at for each in slam.landmarks), default=-1.0)
            # Not all of it: in a race that would take a gigabyte.
            P = slam.belief.covariance[:_NEES_SIZE, :_NEES_SIZE].copy()
            self.sights.append(GateMeasurement(slam.belief.navigation, P, seen_at))


def fly_logged(scenario: Scenario, folder: Path) -> tuple[dict, dict]:
    """Flies a race; returns what race.json holds, and figures of its estimator.

    Args:
        scenario: the race.
        folder: for its files.
    """
    transport = LoggedInProcess(
        lambda autonomy: EstimationLog(scenario.camera.fps, autonomy.HasOutputPort("slam_state"))
    )
    maps: list = []

    shifts = None

    def take(event):
        nonlocal shifts
        match event:
            case GatesMoved():
                shifts = np.reshape(event.shifts, (-1, 2))
            case MapChanged():
                maps.append((event.time, event.gate_map, shifts))

    race = run_race(scenario, folder, sinks=[take], transport=transport)
    explored = race["exploration"]["time_s"] if race["exploration"]["success"] else np.inf
    return race, figures(scenario, transport.log, maps, explored)


def figures(scenario: Scenario, log: EstimationLog, maps: list, explored: float) -> dict:
    """Returns figures of an estimator, NaN where there are none.

    Args:
        scenario: of the race.
        log: of the race.
        maps: of each map: since when it was there (s), the GateMap, and how far gates had moved
            by then (m), (n, 2), or None.
        explored: when the exploration had ended (s).

    Returns:
        by phase, ``_exploring`` and ``_racing``: ``position_rms_m`` and ``attitude_rms_deg`` of
        the estimate, without any alignment; ``nees``, the normalised estimation error squared
        of attitude, position and velocity at the exposures, a dimension, 1 if the covariance is
        right; ``longest_gap_s`` without a marker that counted. After exploring and at the end,
        ``_explored`` and ``_end``: ``map_rms_m`` of the gates' midpoints, and
        ``neighbours_rms_m`` of the vectors from gate to gate.
    """
    truths = np.array(log.truths)
    position = np.array(load_vehicle(scenario.drone)[0].imu.position)
    errors = _estimate_errors(truths, np.array(log.estimates))
    nees = np.array([_nees(truths, sight, position) for sight in log.sights])
    times = np.array([sight.navigation[0] for sight in log.sights])
    result = {}
    for phase, start, end in (("exploring", 0.0, explored), ("racing", explored, np.inf)):
        in_phase = errors[(start <= errors[:, 0]) & (errors[:, 0] < end)]
        rms = np.sqrt(np.mean(in_phase[:, 1:] ** 2, axis=0)) if len(in_phase) else [np.nan] * 2
        of_phase = (start <= times) & (times < end)
        result |= {
            f"position_rms_{phase}_m": float(rms[0]),
            f"attitude_rms_{phase}_deg": float(np.rad2deg(rms[1])),
            f"nees_{phase}": float(np.mean(nees[of_phase])) if of_phase.any() else np.nan,
            f"longest_gap_{phase}_s": _longest_gap(log.sights, start, end),
        }
    for when, time in (("explored", explored), ("end", np.inf)):
        of_time = [entry for entry in maps if entry[0] <= time]
        is_there = of_time and (when == "end" or np.isfinite(explored))
        absolute, relative = _map_errors(scenario, *of_time[-1][1:]) if is_there else 2 * [np.nan]
        result |= {f"map_rms_{when}_m": absolute, f"neighbours_rms_{when}_m": relative}
    return result


def _truth_at(truths: np.ndarray, time: float) -> np.ndarray:
    """Returns the true state, (14,), between those that were written down."""
    k = int(np.clip(np.searchsorted(truths[:, 0], time), 1, len(truths) - 1))
    before, after = truths[k - 1], truths[k]
    share = (time - before[0]) / (after[0] - before[0])
    return before + share * (after - before)


def _estimate_errors(truths: np.ndarray, estimates: np.ndarray) -> np.ndarray:
    """Returns time (s), error of position (m) and attitude (rad) of each in the air, (n, 3)."""
    ground = truths[0, 7]
    rows = [np.zeros((0, 3))]
    for vector in estimates:
        truth, estimate = as_state(_truth_at(truths, vector[0])), as_state(vector)
        if truth.position[2] > ground + _AIRBORNE:
            turn = rotation_between(estimate.quaternion, truth.quaternion)
            offset = truth.position - estimate.position
            rows.append([[vector[0], np.linalg.norm(offset), np.linalg.norm(turn)]])
    return np.vstack(rows)


def _nees(truths: np.ndarray, sight: GateMeasurement, p_BI: np.ndarray) -> float:
    """Returns e^T P^-1 e / n of attitude, position and velocity after a picture.

    Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
    2001, equation 5.4.2-1.
    """
    believed = as_navigation(sight.navigation)
    truth = as_state(_truth_at(truths, believed.time))
    arm = rotation_matrix(truth.quaternion) @ p_BI
    error = np.concatenate(
        [
            rotation_between(believed.quaternion, truth.quaternion),
            truth.position + arm - believed.position,
            truth.velocity + np.cross(truth.angular_velocity, arm) - believed.velocity,
        ]
    )
    return float(error @ np.linalg.solve(sight.covariance, error)) / _NEES_SIZE


def _longest_gap(sights: list[GateMeasurement], start: float, end: float) -> float:
    """Returns the longest time without a marker that counted (s), NaN without pictures."""
    waits = [
        sight.navigation[0] - sight.seen_at
        for sight in sights
        if sight.seen_at >= 0.0 and start <= sight.navigation[0] < end
    ]
    return max(waits, default=np.nan)


def _map_errors(
    scenario: Scenario, gate_map: GateMap, shifts: np.ndarray | None
) -> tuple[float, float]:
    """Returns the RMS error of the gates, and of the vectors between neighbours (m)."""
    track = load_track(scenario.track)
    if shifts is not None:
        track = track.shifted(shifts.tolist())
    errors = {
        gate.number: gate.p_WG - track.gates[gate.number].p_WG
        for gate in gate_map.gates
        if gate.number < len(track.gates)
    }
    between = [
        errors[(number + 1) % len(track.gates)] - error
        for number, error in errors.items()
        if (number + 1) % len(track.gates) in errors
    ]
    return _rms(list(errors.values())), _rms(between)


def _rms(vectors: list) -> float:
    """Returns the root of the mean squared length, NaN of none."""
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=1)))) if vectors else np.nan
