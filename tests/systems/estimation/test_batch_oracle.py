"""The filter beside a batch solution of the same flight, by GTSAM.

All pictures and all samples at once, relinearised until nothing changes: the best that these
measurements can tell. The filter sees each once, and only those of the past.
"""

from typing import NamedTuple

import numpy as np
import pytest

from airrace.scenario import Scenario
from airrace.systems.estimation.error_state import DRONE
from airrace.systems.estimation.gate_projection import Camera, predicted_corners
from airrace.systems.estimation.navigation import Navigation, as_navigation
from airrace.vehicle import GRAVITY
from airrace.vehicle.state import as_state
from tests.worlds.recorded_flight import record_flight

gtsam = pytest.importorskip("gtsam")

SIGMA, FAR = 0.04, 16.0  # px of a corner up to that distance (m), and proportionally beyond
NOISE = Scenario().imu.resolved()
BATCH_RMS = 0.04  # m


class Picture(NamedTuple):
    """A node of the graph.

    Attributes:
        time: of the exposure (s).
        markers: pairs of an ID and corners, (8,) px, of gates that the filter knows.
        state: what the filter knew after it, a Navigation.
    """

    time: float
    markers: list
    state: Navigation


def sigmas(*values):
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values, float))


def pose_of(state):
    return gtsam.Pose3(gtsam.Rot3.Quaternion(*state.quaternion), state.position)


def marker_factor(k, marker, camera, distance):
    """Returns the factor of the corners of a marker: by the pose X(k), and by its gate."""
    id, corners = marker
    keys = [gtsam.symbol("x", k), gtsam.symbol("g", id // 4)]

    def error(this, values, H):
        pose, gate = values.atPose3(keys[0]), values.atVector(keys[1])
        R, nothing = pose.rotation(), np.zeros(3)
        q = R.toQuaternion()
        q = np.array([q.w(), q.x(), q.y(), q.z()])
        state = Navigation(0.0, q, pose.translation(), nothing, nothing, nothing)
        pixels, by_pose, by_gate, _ = predicted_corners(
            state, np.ascontiguousarray(gate), id, camera
        )
        if H is not None:  # GTSAM moves a pose in its own axes
            H[0] = np.hstack([by_pose[:, :3], by_pose[:, 3:] @ R.matrix()])
            H[1] = by_gate
        return pixels - corners

    huber = gtsam.noiseModel.mEstimator.Huber.Create(4.0)
    noise = gtsam.noiseModel.Isotropic.Sigma(8, SIGMA * max(1.0, distance / FAR))
    return gtsam.CustomFactor(gtsam.noiseModel.Robust.Create(huber, noise), keys, error)


def integrated(samples, start, end, bias):
    """Returns the preintegrated samples between two times (s)."""
    params = gtsam.PreintegrationParams.MakeSharedU(GRAVITY)
    params.setGyroscopeCovariance(np.eye(3) * NOISE.gyro_noise**2)
    params.setAccelerometerCovariance(np.eye(3) * NOISE.accelerometer_noise**2)
    params.setIntegrationCovariance(np.eye(3) * 1e-10)
    result, time = gtsam.PreintegratedImuMeasurements(params, bias), start
    for sample in samples[samples[:, 0] > start + 1e-9]:
        dt = min(sample[0], end) - time
        if dt > 1e-9:
            result.integrateMeasurement(sample[4:7], sample[1:4], dt)
            time += dt
    return result


def solve(flight, pictures, gates, camera):
    """Returns the positions p_WI that all measurements together tell, (n, 3)."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    x, v = (lambda k, name=name: gtsam.symbol(name, k) for name in "xv")
    first, b = pictures[0].state, gtsam.symbol("b", 0)
    bias = gtsam.imuBias.ConstantBias(first.accel_bias, first.gyro_bias)
    values.insert(b, bias)
    turn_on = sigmas(*[NOISE.accelerometer_bias] * 3, *[NOISE.gyro_bias] * 3)
    graph.add(gtsam.PriorFactorConstantBias(b, gtsam.imuBias.ConstantBias(), turn_on))
    # At rest on the pad, of which heading and place are known, and the height to 2 cm.
    level = gtsam.Pose3(gtsam.Rot3(), first.position)
    pad = sigmas(0.1, 0.1, 1e-4, 2e-3, 2e-3, 0.02)
    graph.add(gtsam.PriorFactorPose3(x(0), level, pad))
    graph.add(gtsam.PriorFactorVector(v(0), np.zeros(3), sigmas(*[1e-3] * 3)))
    for number, gate in gates.items():
        values.insert(gtsam.symbol("g", number), gate)
        wide = gtsam.PriorFactorVector(
            gtsam.symbol("g", number), gate, sigmas(100.0, 100.0, 100.0, 10.0, 1.0)
        )
        graph.add(wide)
    for k, picture in enumerate(pictures):
        values.insert(x(k), pose_of(picture.state))
        values.insert(v(k), np.array(picture.state.velocity))
        for marker in picture.markers:
            distance = np.linalg.norm(gates[marker[0] // 4][:3] - picture.state.position)
            graph.add(marker_factor(k, marker, camera, distance))
        if k > 0:
            motion = integrated(flight.samples, pictures[k - 1].time, picture.time, bias)
            graph.add(gtsam.ImuFactor(x(k - 1), v(k - 1), x(k), v(k), b, motion))
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return np.array([solved.atPose3(x(k)).translation() for k in range(len(pictures))])


@pytest.mark.repeats
def test_the_filter_is_nearly_as_good_as_a_batch_of_all_measurements():
    flight = record_flight(14.0)
    info, last = flight.camera_info, flight.states[-1]
    intrinsics = np.array([*info.K[[0, 1, 0, 1], [0, 1, 2, 2]], *info.D])
    R_CB = np.ascontiguousarray(info.X_BC.rotation().matrix().T)
    camera = Camera(intrinsics, R_CB, np.array(info.X_BC.translation()))
    gates = {
        landmark.number: gate
        for landmark, gate in zip(last.landmarks, last.belief.gates, strict=True)
    }
    detections = {detections.time: detections for detections in flight.detections}

    def picture(state, time):
        markers = [
            (marker.id, marker.corners.reshape(8))
            for marker in detections[state.time].markers
            if marker.id // 4 in gates
            and marker.id in last.landmarks[last.index_of(marker.id // 4)].counts
        ]
        return Picture(time, markers, as_navigation(state.belief.navigation))

    seen = [state for state in flight.states if state.image_time == state.time > 0.0]
    resting = [state for state in seen if state.at_rest]
    # At rest, all pictures are the same: the last one stands for them, and for the first sample.
    pictures = [picture(resting[-1], resting[0].time)]
    pictures += [picture(state, state.time) for state in seen if not state.at_rest]
    truth = np.array([as_state(flight.truth_at(each.time)).position for each in pictures])
    batch = solve(flight, pictures, gates, camera)

    def rms(positions):
        return np.sqrt(np.mean(np.sum((positions - truth) ** 2, axis=1)[1:]))

    filtered = np.array([each.state.position for each in pictures])
    assert len(gates) >= 2 and sum(len(each.markers) for each in pictures) > 300
    assert rms(batch) < BATCH_RMS
    assert rms(filtered) < 1.5 * BATCH_RMS
    # At the end, both know the same: they differ by no more than the filter's own doubt.
    sigma = np.sqrt(np.diag(last.belief.covariance)[3:6])
    assert last.belief.covariance.shape[0] == DRONE + 5 * len(gates)
    assert np.all(np.abs(filtered[-1] - batch[-1]) < 3.0 * sigma)
