"""GateSlam alone, through its Context, in a synthetic hover before gates."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.scenario import PerceptionConfig
from airrace.systems.estimation.gate_projection import predicted_corners
from airrace.systems.estimation.gate_slam import GateSlam
from airrace.systems.estimation.navigation import as_navigation
from airrace.systems.estimation.slam_filter import MapFrame
from airrace.systems.estimation.strapdown_integrator import history_depth
from airrace.systems.perception.marker_pose import locate, locate_gate
from airrace.systems.types import Detections
from airrace.vehicle import GRAVITY, load_vehicle
from tests.systems.estimation.motions import CAMERA, INFO, NOISE, PERIOD, as_history, navigation

VEHICLE = load_vehicle("Default")[0]
HOVER = np.sqrt(VEHICLE.mass * GRAVITY / VEHICLE.thrust_coefficients.sum()) * np.ones(4)
FPS, LATENCY = 30.0, 0.02
GATE = np.array([15.0, 1.0, 6.25, 0.1, 10.0])
PAD = np.array([0.0, 0.0, 5.0])  # as high as a hover, so that it sees


class Hover:
    """A filter of a drone that stands still on its pad, and then in the air at the same place."""

    def __init__(self, seed=0):
        self.system = GateSlam(
            fps=FPS,
            latency=LATENCY,
            imu_rate=1 / PERIOD,
            frame=MapFrame(0.0, lambda R_WB: PAD),
            noise=NOISE,
            vehicle=VEHICLE,
            config=PerceptionConfig(),
        )
        self.depth = history_depth(FPS, LATENCY, 1 / PERIOD)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.rng = np.random.default_rng(seed)
        self.bias = np.concatenate(
            [0.005 * self.rng.standard_normal(3), 0.2 * self.rng.standard_normal(3)]
        )
        self.samples = [np.full(7, -1.0)] * self.depth
        self.speeds, self.pictures, self.silence = np.zeros(4), 0, 0.002
        self.system.GetInputPort("camera_info").FixValue(self.context, Value[object](INFO))

    def wait(self, duration, *ids, gate=GATE, number=0, fault=None):
        """Lets time pass; in every picture there are markers of a gate."""
        for _ in range(round(duration * FPS)):
            exposure = self.pictures / FPS
            self.pictures += 1
            while self.samples[-1][0] + PERIOD <= exposure + LATENCY:
                self._feel()
            markers = () if not ids else self._see(gate, number, ids)
            detections = Detections(exposure, markers)
            self._update(exposure + LATENCY, fault(detections) if fault else detections)

    @property
    def time(self):
        return self.context.get_time()

    def _feel(self):
        noise = np.repeat([NOISE.gyro, NOISE.accel], 3) / np.sqrt(PERIOD)
        at_rest = np.array([0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
        values = at_rest + self.bias + noise * self.rng.standard_normal(6)
        time = max(self.samples[-1][0], 0.0) + PERIOD
        self.samples = [*self.samples[1:], np.array([time, *values])]

    def _see(self, gate, number, ids):
        truth = as_navigation(navigation(p=PAD))
        corners = {}
        for id in ids:
            pixels = predicted_corners(truth, gate, id, CAMERA)[0]
            corners[id] = (pixels + 0.03 * self.rng.standard_normal(8)).reshape(4, 2)
        covariance = 0.01 * np.eye(8)
        if ids == (0, 2):
            found = locate_gate(ids, list(corners.values()), [covariance] * 2, INFO).values()
        else:
            found = [locate(id, c, covariance, INFO) for id, c in corners.items()]
        return tuple(dc.replace(marker, id=marker.id + 4 * number) for marker in found)

    def _update(self, time, detections):
        for name, value in (
            ("imu_history", as_history(self.samples).ravel()),
            ("rotor_speeds", self.speeds),
            ("imu_silence", [self.silence]),
            ("detections", Value[object](detections)),
        ):
            self.system.GetInputPort(name).FixValue(self.context, value)
        self.simulator.AdvanceTo(time + 1e-3)  # the update is at that time

    def take_off(self):
        self.speeds = HOVER

    def read(self, port):
        return self.system.GetOutputPort(port).Eval(self.context)


@pytest.fixture
def hover():
    hover = Hover()
    hover.wait(0.5)
    hover.take_off()
    return hover


def test_at_rest_it_learns_attitude_and_biases():
    hover = Hover()
    assert hover.read("corrections")[0] < 0.0
    hover.wait(1.0)
    state = as_navigation(hover.read("corrections"))
    np.testing.assert_allclose(state.gyro_bias, hover.bias[:3], atol=3e-3)
    np.testing.assert_allclose(state.position, PAD)
    # What looks like a tilt of the pad is the bias.
    P = hover.read("slam_state").belief.covariance
    assert np.sqrt(P[0, 0]) == pytest.approx(NOISE.accel_turn_on / GRAVITY, rel=0.05)


def test_a_gate_that_is_seen_at_rest_keeps_the_heading():
    """On the pad the heading is known; in the air, it is that of the gyroscope, or of the gate."""
    sigmas = []
    for ids in ((), (0, 2)):
        hover = Hover()
        hover.wait(1.0, *ids)
        hover.take_off()
        hover.wait(3.0)
        assert len(hover.read("slam_state").landmarks) == len(ids) // 2
        hover.wait(1.0, 0, 2)
        sigmas.append(np.sqrt(hover.read("slam_state").belief.covariance[2, 2]))
    assert sigmas[1] < 0.7 * sigmas[0]


def test_all_pictures_at_rest_tell_where_a_gate_is():
    """Their noise averages out; without, it would count as one picture."""
    sigmas, errors = [], []
    for pictures in (5, 60):
        hover = Hover()
        hover.wait(pictures / FPS, 0, 2)
        belief = hover.read("slam_state").belief
        sigmas.append(np.sqrt(belief.covariance[18, 18]))
        errors.append(abs(belief.gates[0, 3] - GATE[3]))
    assert sigmas[1] < 0.7 * sigmas[0]
    assert errors[1] < 3.0 * sigmas[1]


def test_a_broken_picture_at_rest_is_not_averaged():
    hover = Hover()

    def broken(detections):
        markers = [dc.replace(m, corners=np.full((4, 2), np.nan)) for m in detections.markers]
        return dc.replace(detections, markers=tuple(markers))

    hover.wait(0.1, 0, 2, fault=broken)
    hover.wait(0.2, 0, 2)
    assert len(hover.read("slam_state").landmarks) == 1


def test_a_gate_in_sight_tells_tilt_and_biases(hover):
    hover.wait(2.0, 0, 2)
    state = as_navigation(hover.read("corrections"))
    np.testing.assert_allclose(state.quaternion, [1, 0, 0, 0], atol=2e-3)
    np.testing.assert_allclose(state.accel_bias, hover.bias[3:], atol=0.03)
    np.testing.assert_allclose(state.position, PAD, atol=0.1)
    (gate,) = hover.read("gate_map").gates
    np.testing.assert_allclose(gate.p_WG, GATE[:3], atol=0.1)
    assert gate.heading == pytest.approx(GATE[3], abs=0.02)
    assert {marker.id for marker in hover.read("gate_map").markers} == {0, 1, 2, 3}


def test_its_errors_are_as_great_as_it_says():
    total, count = 0.0, 12
    for seed in range(count):
        hover = Hover(seed)
        hover.wait(0.5)
        hover.take_off()
        hover.wait(1.0, 0, 2)
        state, belief = as_navigation(hover.read("corrections")), hover.read("slam_state").belief
        off = PAD - state.position
        total += off @ np.linalg.solve(belief.covariance[3:6, 3:6], off) / 3
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    assert 0.2 < total / count < 2.0


def test_without_pictures_it_grows_uncertain_and_keeps_up(hover):
    hover.wait(1.0, 0, 2)
    sigma = np.sqrt(hover.read("slam_state").belief.covariance[3, 3])
    before = hover.read("gate_map")
    hover.wait(5.0, fault=lambda detections: Detections())
    state = hover.read("slam_state")
    assert np.sqrt(state.belief.covariance[3, 3]) > 2 * sigma
    assert hover.time - state.time < 0.1
    after = hover.read("gate_map")
    assert (after.time, after.detections) == (before.time, before.detections)
    np.testing.assert_array_equal(after.gates[0].p_WG, before.gates[0].p_WG)
    hover.wait(1.0, 0, 2)
    assert np.linalg.norm(PAD - as_navigation(hover.read("corrections")).position) < 0.1


def test_a_misread_marker_is_no_gate(hover):
    """Two sights of a gate that is not there, far apart."""
    hover.wait(1.0, 0, 2)
    hover.wait(1 / FPS, 0, number=5)
    hover.wait(1.0, 0, 2)
    hover.wait(1 / FPS, 0, number=5)
    assert len(hover.read("slam_state").landmarks) == 1
    assert hover.read("gate_map").refused


def test_a_gate_that_moved_is_followed_and_stays_in_the_map(hover):
    hover.wait(1.0, 0, 2)
    moved = GATE + [1.0, 0.6, 0.0, 0.0, 0.0]
    hover.wait(2.0, 0, 2, gate=moved)
    (gate,) = hover.read("gate_map").gates
    assert np.linalg.norm(gate.p_WG - moved[:3]) < 0.5
    assert sum(hover.read("gate_map").refused.values()) > 0


@pytest.mark.slow
def test_a_gate_that_entered_wrongly_enters_anew(hover):
    """Its first sights were of another heading, as the mirrored pose of one marker has it."""
    hover.wait(1.0, 0, 2)
    turned = GATE + [2.0, -4.0, 0.0, 1.0, 0.0]
    hover.wait(0.3, 0, gate=turned, number=1)
    assert len(hover.read("slam_state").landmarks) == 2
    right = GATE + [1.0, 1.0, 0.0, -0.1, 0.0]
    hover.wait(1.5, 0, 2, gate=right, number=1)
    gates = hover.read("gate_map").gates
    np.testing.assert_allclose(gates[1].p_WG, right[:3], atol=0.1)
    assert gates[1].heading == pytest.approx(right[3], abs=0.02)
    assert hover.read("slam_state").refused_in_a_row == 0


def test_broken_detections_change_nothing(hover):
    hover.wait(1.0, 0, 2)
    before = hover.read("gate_map").markers[0].count

    def broken(detections):
        markers = tuple(
            dc.replace(marker, covariance=np.full((6, 6), np.nan)) for marker in detections.markers
        )
        return dc.replace(detections, markers=markers)

    hover.wait(0.2, 0, 2, fault=broken)
    assert hover.read("gate_map").markers[0].count == before
    assert np.isfinite(hover.read("corrections")).all()


def test_it_says_why_it_is_lost_and_takes_up_nothing_more(hover):
    hover.wait(1.0, 0, 2)
    hover.silence = 0.1
    hover.wait(0.5, 0, 2)
    assert hover.read("estimate_fault") == ""
    hover.silence = 0.3
    hover.wait(0.1, 0, 2)
    assert hover.read("estimate_fault") == "the IMU fell silent"
    before = hover.read("corrections").copy()
    hover.silence = 0.002
    hover.wait(0.5, 0, 2)
    assert hover.read("estimate_fault") == "the IMU fell silent"
    np.testing.assert_array_equal(hover.read("corrections"), before)
