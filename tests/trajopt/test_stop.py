"""How a drone comes down that does not know where it is."""

import numpy as np
import pytest

from airrace.trajopt.reference import as_reference
from airrace.trajopt.stop import Landing, Stop
from airrace.vehicle.state import STATE_SIZE, as_state

PERIOD = 0.01  # s


def descend(height, velocity=(0.0, 0.0, 0.0), error=0.0):
    """Returns the references of a landing until the ground, (18, n), and the true heights (m).

    The drone does what it is told, as it believes, and sinks less by an error that grows (m/s^2).
    """
    estimate = np.zeros(STATE_SIZE)
    state = as_state(estimate)
    state.quaternion[0], state.position[2], state.velocity[:] = 1.0, height, velocity
    landing = Landing(Stop.of(estimate, pad=0.0))
    told, heights = [], [height]
    while heights[-1] > 0.0 and len(told) < 10_000:
        time = len(told) * PERIOD
        told.append(landing.reference(time))
        heights.append(as_reference(told[-1]).position[2] + error * time**2 / 2)
    return np.array(told).T, np.array(heights[1:])


@pytest.mark.parametrize("height", [0.5, 1.0, 7.0])
def test_where_the_height_is_right_it_touches_down_slowly(height):
    told, heights = descend(height, velocity=(3.0, 0.0, 0.0))
    assert heights[-1] <= 0.0
    assert as_reference(told).velocity[2, -1] == pytest.approx(-0.5, abs=2e-3)
    assert (np.diff(heights) >= -2.0 * PERIOD - 1e-9).all()


def test_it_comes_down_though_it_believes_to_sink_faster_than_it_does():
    """After 8 s the error is as fast as a slow descent, which would become a climb."""
    told, heights = descend(7.0, error=0.06)
    assert heights[-1] <= 0.0 and heights[-2] - heights[-1] < 2.0 * PERIOD  # no fall
    reference = as_reference(told)
    sinking, beneath = np.diff(reference.position[2]) / PERIOD, reference.position[2, :-1] < 0.0
    assert beneath.sum() > 100
    np.testing.assert_allclose(sinking[beneath], reference.velocity[2, 1:][beneath], atol=1e-3)
