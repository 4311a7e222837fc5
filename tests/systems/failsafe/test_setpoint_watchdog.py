import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.systems.control.setpoint import (
    IDLE,
    NO_SETPOINT,
    POSITION,
    RATES,
    as_setpoint,
    setpoint_vector,
)
from airrace.systems.failsafe.setpoint_watchdog import (
    FOLLOW,
    HOVER,
    HOVER_TIME,
    LAND,
    LANDING_SPEED,
    OFF,
    SILENCE,
    SetpointWatchdog,
)

YAW = 0.7


class Watched:
    """A watchdog whose client and drone are set by hand."""

    def __init__(self, height, armed=1.0):
        self.system = SetpointWatchdog(standing_height=0.1)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.armed = armed
        self.hear()
        self.fly(height)

    def hear(self):
        """A set-point comes now."""
        self.sent = NO_SETPOINT._replace(
            kind=RATES, time=self.context.get_time(), armed=self.armed, thrust=0.3
        )
        self.system.GetInputPort("setpoint").FixValue(self.context, setpoint_vector(self.sent))

    def fly(self, height, x=2.0):
        q = [np.cos(YAW / 2), 0.0, 0.0, np.sin(YAW / 2)]
        estimate = [0.0, *q, x, -1.0, height, *6 * [0.0]]
        self.system.GetInputPort("filtered_estimate").FixValue(self.context, estimate)

    def wait(self, seconds):
        self.simulator.AdvanceTo(self.context.get_time() + seconds)

    @property
    def phase(self):
        return self.system.phase(self.context)

    @property
    def setpoint(self):
        return as_setpoint(self.system.get_output_port().Eval(self.context).copy())


def test_set_points_are_handed_on_while_they_come():
    watched = Watched(height=3.0)
    for _ in range(10):
        watched.wait(0.9 * SILENCE)
        assert watched.phase == FOLLOW
        np.testing.assert_array_equal(
            setpoint_vector(watched.setpoint), setpoint_vector(watched.sent)
        )
        watched.hear()


def test_on_the_ground_the_motors_stop_after_half_a_second():
    watched = Watched(height=0.1)
    watched.wait(0.49)
    assert watched.phase == FOLLOW and watched.setpoint.kind == RATES
    watched.wait(0.04)
    assert watched.phase == OFF and watched.setpoint.kind == IDLE
    watched.hear()
    watched.wait(0.02)
    assert watched.phase == FOLLOW


def test_in_the_air_it_hovers_where_it_was_and_is_set_down():
    watched = Watched(height=3.0)
    watched.wait(SILENCE + 0.03)
    assert watched.phase == HOVER
    held = watched.setpoint
    assert held.kind == POSITION and held.armed and held.has_yaw
    np.testing.assert_allclose(held.position, [2.0, -1.0, 3.0])
    assert held.yaw == pytest.approx(YAW)
    watched.fly(3.0, x=5.0)  # it is not where it should be: that does not move its place
    watched.wait(HOVER_TIME - 0.05)
    assert watched.phase == HOVER
    np.testing.assert_allclose(watched.setpoint.position, [2.0, -1.0, 3.0])
    watched.wait(0.45)
    assert watched.phase == LAND
    down = 3.0 - watched.setpoint.position[2]
    assert down == pytest.approx(LANDING_SPEED * 0.4, abs=LANDING_SPEED * 0.04)
    np.testing.assert_allclose(watched.setpoint.velocity, [0.0, 0.0, -LANDING_SPEED])
    # As long as it follows down, the motors turn; the ground stops it.
    for _ in range(5):
        watched.fly(watched.setpoint.position[2])
        watched.wait(0.5)
        assert watched.phase == LAND
    watched.wait(0.75)
    assert watched.phase == OFF and watched.setpoint.kind == IDLE
    # Off is off, even if it hops.
    watched.fly(3.0)
    watched.wait(1.0)
    assert watched.phase == OFF
    watched.hear()
    watched.wait(0.02)
    assert watched.phase == FOLLOW


def test_a_drone_that_is_not_armed_is_left_alone():
    watched = Watched(height=0.1, armed=0.0)
    watched.wait(3.0)
    assert watched.phase == FOLLOW and not watched.setpoint.armed
