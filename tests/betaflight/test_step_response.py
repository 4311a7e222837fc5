"""Steps of the firmware's rate loop."""

import numpy as np
import pytest

from airrace.betaflight.step_response import StepResponse, fly_step


def test_what_is_said_of_a_step():
    times = np.arange(100) / 1000
    rates = 2.0 * np.minimum(times / 0.05, 1.2)
    step = StepResponse(2.0, times, rates, np.tile([[1000.0], [1003.0]], (50, 4)))
    assert step.rise_times == pytest.approx((0.032, 0.046))
    assert step.overshoot == pytest.approx(0.2) and step.trembling == pytest.approx(3.0)
    never = step._replace(rates=np.zeros(100))
    assert never.rise_times == (np.inf, np.inf) and never.overshoot == 0.0


def test_more_p_is_quicker_and_noise_makes_motors_tremble(firmware):
    shipped = fly_step()
    quick = fly_step("set p_roll = 90", imu="racing")
    assert 0.03 < shipped.rise_times[0] < 0.06 and shipped.overshoot < 0.3
    assert quick.rise_times[0] < shipped.rise_times[0] - 0.005
    assert quick.trembling > 3.0 * shipped.trembling
