"""Betaflight's angle mode: the sticks ask for angles of roll and pitch, and for a rate of yaw."""

import math

import numpy as np

from airrace.betaflight.sticks import Read, Sticks, needed_values
from airrace.vehicle import Vehicle
from airrace.vehicle.state import as_plant_state, as_state

_ANGLE = 1  # number of the mode


class AngleSticks(Sticks):
    """Commands thrust, angles of roll and pitch, and a rate of yaw."""

    # These would add to what the angles ask for.
    _ONLY = {**Sticks._ONLY, "angle_earth_ref": "0", "angle_feedforward": "0"}
    _MODES = {**Sticks._MODES, _ANGLE: "switches the angle mode on"}

    def __init__(self, dump: str, vehicle: Vehicle):
        """See Sticks."""
        super().__init__(dump, vehicle)
        values = needed_values(dump, {"angle_limit", "angle_p_gain"})
        # 1/s: a rate for each angle that is missing, see its pidLevel().
        self._gain = max(0.1 * float(values["angle_p_gain"]), 0.1)
        # A stick that would ask for its greatest rate asks for the greatest angle.
        for curve in self._curves[:2]:
            curve *= float(values["angle_limit"]) / curve[-1]

    def shown_attitude(self, read_state: Read) -> np.ndarray:
        return as_plant_state(read_state()).quaternion

    def command_of(self, rates: np.ndarray, read_estimate: Read) -> np.ndarray:
        """Returns [f, roll, pitch, w_z], (N, rad, rad, rad/s), for thrust and rates, see Sticks.

        The angles are those at which Betaflight's loop, w = k (wanted - actual), asks for just the
        wanted rates; those that are out of reach stay at angle_limit.
        """
        w, x, y, z = as_state(read_estimate()).quaternion
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = math.asin(min(max(2.0 * (w * y - x * z), -1.0), 1.0))
        f, roll_rate, pitch_rate, yaw_rate = rates
        gain = self._gain
        return np.array((f, roll + roll_rate / gain, pitch + pitch_rate / gain, yaw_rate))
