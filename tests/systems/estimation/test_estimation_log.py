"""What the figures of benchmarks.estimation are made of."""

import numpy as np
import pytest

from airrace.scenario import Scenario
from airrace.systems.estimation.navigation import as_navigation
from airrace.track import load_track
from airrace.track.gate_map import GateEstimate, GateMap
from tests.worlds.estimation_log import EstimationLog, GateMeasurement, figures


class TestFiguresOfAnEstimator:
    """Of a drone that flies along x at 2 m/s, and is believed to be 3 cm beside its place."""

    SIGMA = 0.03

    def log(self, turn=0.0):
        log = EstimationLog(30.0, estimates=True)
        times = np.arange(0.0, 10.0, 0.01)
        for time in times:
            state = [1.0, 0, 0, 0, 2.0 * time, 0, min(time, 2.0), 0, 0, 0, 2.0, 0, 0]
            q = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
            log.truths.append(np.array([time, *state]))
            log.estimates.append(np.array([time, *q, *state[4:]]))
            log.estimates[-1][6] += self.SIGMA
        for time in np.arange(1.0, 9.0, 0.1):
            vector, P = np.zeros(17), np.eye(9)
            vector[0] = time
            believed = as_navigation(vector)
            believed.quaternion[0], believed.velocity[0] = 1.0, 2.0
            believed.position[:] = [2.0 * time, self.SIGMA, min(time, 2.0)]
            P[4, 4] = self.SIGMA**2
            log.sights.append(GateMeasurement(vector, P, min(time, 6.0)))
        return log

    def figures(self, **kwargs):
        gate_map = GateMap(
            gates=tuple(
                GateEstimate(n, gate.p_WG + [0.01 * n, 0.0, 0.1], 0.0, 10.0)
                for n, gate in enumerate(load_track("student-airrace").gates[:4])
            )
        )
        maps = [(0.0, GateMap(), None), (7.0, gate_map, None)]
        return figures(Scenario(), self.log(**kwargs), maps, explored=5.0)

    def test_errors(self):
        found = self.figures(turn=0.01)
        for phase in ("exploring", "racing"):
            assert found[f"position_rms_{phase}_m"] == pytest.approx(self.SIGMA)
            assert found[f"attitude_rms_{phase}_deg"] == pytest.approx(np.rad2deg(0.01))

    def test_one_sigma_in_one_of_nine_dimensions(self):
        found = self.figures()
        assert found["nees_exploring"] == pytest.approx(1 / 9, rel=1e-3)
        assert found["nees_racing"] == pytest.approx(1 / 9, rel=1e-3)

    def test_gaps(self):
        found = self.figures()
        assert found["longest_gap_exploring_s"] == 0.0
        assert found["longest_gap_racing_s"] == pytest.approx(2.9)

    def test_maps(self):
        found = self.figures()
        assert np.isnan(found["map_rms_explored_m"])
        x = 0.01 * np.arange(4)
        assert found["map_rms_end_m"] == pytest.approx(np.sqrt(np.mean(x**2) + 0.1**2))
        assert found["neighbours_rms_end_m"] == pytest.approx(0.01)
