"""The filter of drone and gates, from one picture to the next, without Drake."""

import dataclasses as dc
import functools
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from airrace.math.quaternion import rotation_matrix
from airrace.scenario import PerceptionConfig
from airrace.systems.estimation import landmarks
from airrace.systems.estimation.alignment import NOT_SEEN, Rest, aligned, averaged, rested
from airrace.systems.estimation.error_state import DRONE, ImuNoise, propagate
from airrace.systems.estimation.gate_projection import GATE, Camera
from airrace.systems.estimation.kalman_update import (
    Belief,
    attitude_sigma,
    relative_covariance,
    updated,
    with_spacing,
)
from airrace.systems.estimation.landmarks import Candidate, Landmark
from airrace.systems.estimation.navigation import Navigation, navigation_vector
from airrace.systems.estimation.slam_state import SlamState
from airrace.systems.mapping.gate_filter import (
    AT_GATE,
    RULES_SIGMA,
    GateFilter,
    GateState,
    as_gate,
    gate_vector,
    has_spacing_of_rules,
    least_observed,
)
from airrace.systems.mapping.observation import OFF_MAP, UNCONFIRMED, UNKNOWN_TIME, refusal
from airrace.systems.perception.detection_checks import FOREIGN_ID
from airrace.systems.perception.marker_pose import GATE_SPACING, intrinsics
from airrace.systems.types import Detection, Detections
from airrace.track import PYLON_BASE_RADIUS
from airrace.vehicle.camera_info import CameraInfo

# Normalised innovation squared of a marker's eight coordinates: above the first, its weight
# falls; above the second it is refused.
_DOUBTFUL, REFUSED = 16.0, 60.0
_COARSE_ATTITUDE = np.deg2rad(0.3)  # above, an update is iterated
_ITERATIONS = 6
_KNOWN_SIGMA = 0.3  # m, of a gate's position relative to the drone, before it is in the map
# A gate that was refused in so many pictures in a row has moved: variances added. Or it entered
# wrongly, see _was_wrong().
_MOST_REFUSED = 5
_MOVED = gate_vector(GateState(np.array([1.0, 1.0, 0.01]), 0.01, 0.0))  # m^2, rad^2
# Markers are used from so many times the range of a mapper that is told its pose: who sees the next
# gate while the last one is still in view carries his heading from gate to gate.
_BEYOND = 1.5
_PROCESS_NOISE = 1.3  # times that of the sensor


class MapFrame(NamedTuple):
    """Where the frame of the map is: the drone's pose on its pad defines it."""

    heading: float  #: of the drone (rad)
    #: A function of R_WB, (3, 3), to p_WI of the sensor (m), (3,).
    position: Callable[[np.ndarray], np.ndarray]


class SlamFilter:
    """Estimates drone and gates together; what it knows is in a SlamState."""

    def __init__(
        self, *, frame: MapFrame, noise: ImuNoise, p_BI: np.ndarray, config: PerceptionConfig
    ):
        """Constructs the filter.

        Args:
            frame: of the map.
            noise: of the inertial sensor, as its data sheet says.
            p_BI: where that is in the body (m), (3,).
            config: of which max_range, max_gates and min_observations matter; markers are used
                from 1.5 times that range.
        """
        self._frame = frame
        self._turn_on = noise
        self._noise = ImuNoise(
            _PROCESS_NOISE * noise.gyro,
            _PROCESS_NOISE * noise.accel,
            _PROCESS_NOISE * noise.gyro_walk,
            _PROCESS_NOISE * noise.accel_walk,
            noise.accel_turn_on,
            noise.period,
        )
        self._config = config

        @functools.lru_cache(maxsize=1)  # it is the same for a whole race
        def camera(info):
            R_CB = np.ascontiguousarray(info.X_BC.rotation().matrix().T)
            return Camera(intrinsics(info), R_CB, info.X_BC.translation() - p_BI)

        self._camera = camera

    def propagated(
        self, state: SlamState, history: np.ndarray, time: float, rotors_turn: bool
    ) -> SlamState:
        """Returns the state carried forward to a time.

        Args:
            state: before.
            history: samples, newest first, (n, 7).
            time: (s).
            rotors_turn: whether they do now, or did before.
        """
        if state.at_rest and not rotors_turn:
            rest = rested(state.rest, history, state.time, time)
            return self._aligned(state, rest, time) if rest.samples else state
        if state.time < 0.0 or time <= state.time:
            return dc.replace(state, at_rest=False)
        navigation, covariance = propagate(
            state.belief.navigation, state.belief.covariance, history, time, self._noise
        )
        belief = Belief(navigation, state.belief.gates, covariance)
        return dc.replace(state, belief=belief, at_rest=False)

    def _aligned(self, state: SlamState, rest: Rest, time: float) -> SlamState:
        """Returns the state of a drone at rest, without gates: each picture enters its own anew.

        That has the means of all corners at rest. Its gates tell the heading of what follows,
        which is known best on the pad.
        """
        quaternion, gyro_bias, accel_bias, P = aligned(rest, self._frame.heading, self._turn_on)
        position = self._frame.position(rotation_matrix(quaternion))
        navigation = Navigation(time, quaternion, position, np.zeros(3), gyro_bias, accel_bias)
        belief = Belief(navigation_vector(navigation), np.zeros((0, GATE)), P)
        return dc.replace(state, belief=belief, landmarks=(), rest=rest)

    def updated(self, state: SlamState, detections: Detections, info: CameraInfo) -> SlamState:
        """Returns the state with the markers of a picture, to whose time it was propagated."""
        if detections.time <= state.image_time:
            return state
        refused = Counter(state.refused)
        refused.update(reason for reason, _ in detections.refused)
        by_gate: dict[int, list[Detection]] = {}
        still = dict(state.still)
        max_id = 4 * self._config.max_gates - 1
        for marker in detections.markers:
            reason = refusal(marker, max_id, _BEYOND * self._config.max_range)
            if reason is None and state.time < 0.0:
                reason = UNKNOWN_TIME
            if reason is not None:
                refused[reason] += 1
                continue
            if state.at_rest:
                still[marker.id] = averaged(still.get(marker.id, NOT_SEEN), marker)
                marker = still[marker.id].put_into(marker)
            by_gate.setdefault(marker.id // 4, []).append(marker)
        state = dc.replace(state, image_time=detections.time, innovations=(), still=still)
        camera = self._camera(info)
        for number, markers in sorted(by_gate.items()):
            index = state.index_of(number)
            if index is None:
                state, why = self._with_new_gate(state, number, markers, camera)
            else:
                state, why = self._with_markers(state, index, markers, camera)
            refused.update(why)
        in_a_row = state.refused_in_a_row
        if state.innovations:
            fits = any(landmark.seen_at == state.image_time for landmark in state.landmarks)
            in_a_row = 0 if fits else in_a_row + 1
        foreign = sum(reason == FOREIGN_ID for reason, _ in detections.refused)
        return dc.replace(
            state,
            refused=dict(refused),
            detections=state.detections + len(detections.markers) + foreign,
            refused_in_a_row=in_a_row,
        )

    def _with_new_gate(self, state, number, markers, camera):
        """Returns the state after a measurement of a new gate, and reasons of refused markers."""
        belief = landmarks.new_gate(state.belief, markers, camera)
        if belief is None:
            return state, len(markers) * [UNCONFIRMED]
        time, before = state.image_time, state.candidates.get(number)
        candidate = landmarks.agreeing(before, time, belief.gates[-1])
        candidates: dict[int, Candidate] = state.candidates | {number: candidate}
        state = dc.replace(state, candidates=candidates)
        if not landmarks.is_confirmed(candidate):
            return state, len(markers) * [UNCONFIRMED]
        counts = {marker.id: 1 for marker in markers}
        known = (*state.landmarks, Landmark(number, counts=counts, seen_at=time))
        return dc.replace(state, belief=belief, landmarks=known), []

    def _with_markers(self, state, index, markers, camera):
        """Returns the state after a measurement of a gate in it, and reasons of refusals."""
        belief, landmark = state.belief, state.landmarks[index]
        counts, outliers = Counter(landmark.counts), Counter(landmark.outliers)
        innovations, accepted = [], 0
        for marker in markers:
            measurement = landmarks.make_measurement(index, [marker])
            coarse = attitude_sigma(belief) > _COARSE_ATTITUDE or landmark.refused_in_a_row
            iterations = _ITERATIONS if coarse else 1
            after, fit = updated(belief, measurement, camera, 1.0, iterations)
            innovations.append((marker.id, fit.squared))
            if not fit.squared <= REFUSED:
                outliers[marker.id] += 1
                continue
            if fit.squared > _DOUBTFUL:
                inflation = fit.squared / _DOUBTFUL
                after, _ = updated(belief, measurement, camera, inflation, iterations)
            belief = after
            counts[marker.id] += 1
            accepted += 1
        in_a_row = 0 if accepted else landmark.refused_in_a_row + 1
        landmark = dc.replace(
            landmark,
            counts=dict(counts),
            outliers=dict(outliers),
            refused_in_a_row=in_a_row,
            seen_at=state.image_time if accepted else landmark.seen_at,
        )
        state = dc.replace(state, innovations=(*state.innovations, *innovations))
        why = (len(markers) - accepted) * [OFF_MAP]
        if _was_wrong(landmark):
            return _without_gate(state, index), why
        if in_a_row and in_a_row % _MOST_REFUSED == 0:
            belief = _loosened(belief, index)
        belief, landmark = self._certain(belief, index, landmark)
        every = (*state.landmarks[:index], landmark, *state.landmarks[index + 1 :])
        return dc.replace(state, belief=belief, landmarks=every), why

    def _certain(self, belief, index, landmark):
        """Returns belief and landmark with what follows once enough is known of the gate."""
        at = DRONE + GATE * index + AT_GATE.spacing
        spacing, variance = as_gate(belief.gates[index]).spacing, belief.covariance[at, at]
        if not landmark.has_spacing and has_spacing_of_rules(spacing, variance):
            belief = with_spacing(belief, index, GATE_SPACING, RULES_SIGMA)
            landmark = dc.replace(landmark, has_spacing=True)
        if landmark.is_known:
            return belief, landmark
        relative = GateFilter(belief.gates[index], relative_covariance(belief, index), 0.0)
        is_known = (
            least_observed(landmark.counts) >= self._config.min_observations
            and relative.spacing > 2 * PYLON_BASE_RADIUS
            and relative.is_certain(_KNOWN_SIGMA)
        )
        return belief, dc.replace(landmark, is_known=is_known)


def _was_wrong(landmark: Landmark) -> bool:
    """Whether a gate entered wrongly, as the mirrored pose of a marker: most markers are refused.

    That of a gate that is known well enough to fly through means that it has moved.
    """
    refused, counted = (sum(each.values()) for each in (landmark.outliers, landmark.counts))
    in_a_row = landmark.refused_in_a_row >= _MOST_REFUSED
    return in_a_row and refused > counted and not landmark.is_known


def _without_gate(state: SlamState, index: int) -> SlamState:
    """Returns the state without a gate, which may enter anew; of all else the same is known."""
    belief, number = state.belief, state.landmarks[index].number
    at = DRONE + GATE * index + np.arange(GATE)
    covariance = np.delete(np.delete(belief.covariance, at, axis=0), at, axis=1)
    return dc.replace(
        state,
        belief=Belief(belief.navigation, np.delete(belief.gates, index, axis=0), covariance),
        landmarks=(*state.landmarks[:index], *state.landmarks[index + 1 :]),
        candidates={n: each for n, each in state.candidates.items() if n != number},
    )


def _loosened(belief: Belief, index: int) -> Belief:
    """Returns the belief with a gate that may be elsewhere by about a metre."""
    at = DRONE + GATE * index
    covariance = belief.covariance.copy()
    covariance[at : at + GATE, at : at + GATE] += np.diag(_MOVED)
    return Belief(belief.navigation, belief.gates, covariance)
