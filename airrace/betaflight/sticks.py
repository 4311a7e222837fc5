"""From thrust and body rates to the sticks of a radio, and from motor outputs to rotor speeds."""

import re
from collections.abc import Mapping

import numpy as np

from airrace.betaflight.firmware_process import CHANNELS
from airrace.betaflight.settings import values_of
from airrace.common.errors import UserError
from airrace.vehicle import Vehicle

_LOW, _MIDDLE, _HIGH = 1000, 1500, 2000
_NO_SIGNAL = 800  # below rx_min_usec
_HALF = _HIGH - _MIDDLE
_TABLE = np.linspace(0.0, 1.0, 1001)  # deflections of a stick
_AXES = "roll", "pitch", "yaw"
_NEEDED = {
    "motor_idle",
    "yaw_motors_reversed",
    "min_check",
    "deadband",
    "yaw_deadband",
    "rates_type",
} | {f"{axis}_{name}" for axis in _AXES for name in ("rc_rate", "srate", "expo")}
_ARM = re.compile(r"^aux \d+ 0 (\d+) (\d+) (\d+)", re.MULTILINE)
# Of Betaflight's motors 1 to 4: where they are seen from above, ahead and to the left.
_PLACES = ((-1, -1), (1, -1), (-1, 1), (1, 1))


class Sticks:
    """What the settings make of sticks, and so which sticks make what is wanted."""

    def __init__(self, dump: str, vehicle: Vehicle):
        """Args: dump: the settings, see configure(). vehicle: the drone.

        Raises:
            UserError: if the settings cannot be flown by thrust and rates, or not this drone.
        """
        values = values_of(dump)
        if missing := _NEEDED - values.keys():
            raise UserError(
                f"Betaflight's settings do not say {', '.join(sorted(missing))}: it is another "
                "Betaflight than the one of `airrace betaflight build`."
            )
        self._order = _motors_of(vehicle)
        _check_directions(vehicle, self._order, values["yaw_motors_reversed"] == "ON")
        self._max_speeds = vehicle.max_speeds
        self._most = float(vehicle.max_thrusts.sum())
        self._idle = int(values["motor_idle"]) / 1e4
        self._lowest = int(values["min_check"])
        self._curves = [_rates(axis, values) for axis in _AXES]
        dead = int(values["deadband"]), int(values["deadband"]), int(values["yaw_deadband"])
        self._dead = np.array(dead, float)
        self._arm, self._armed = _arm_channel(dump)
        self._left = np.zeros(4)  # of what was wanted, that whole numbers could not say yet

    def at_rest(self, armed: bool) -> list[int]:
        """Returns channels of the radio, with its throttle down."""
        channels = [_MIDDLE, _MIDDLE, _LOW, _MIDDLE, *(CHANNELS - 4) * [_LOW]]
        if armed:
            channels[self._arm] = self._armed
        return channels

    def no_signal(self) -> list[int]:
        """Returns channels of a radio that hears nothing: no value that a stick could have."""
        return CHANNELS * [_NO_SIGNAL]

    def channels_of_thrust(self, share: float) -> list[int]:
        """Returns channels for a share of the greatest thrust, with the other sticks at rest."""
        channels = self.channels(np.array((share * self._most, 0.0, 0.0, 0.0)))
        self._left[:] = 0.0
        return channels

    def channels(self, command: np.ndarray) -> list[int]:
        """Returns the radio's channels for a command.

        They are whole numbers; what is lost by that is added to the next command, so that on
        average nothing is.

        Args: command: [f, w_x, w_y, w_z], total thrust (N) and rates in B (rad/s), (4,).
        """
        # Thrust goes with the square of a rotor's speed, and the output of a motor is its speed.
        share = np.sqrt(np.clip(command[0] / self._most, 0.0, 1.0))
        throttle = max(0.0, (share - self._idle) / (1.0 - self._idle))
        # Sticks to the right and ahead: roll to the right, nose down, yaw to the right.
        wanted = np.degrees(command[1:]) * (1.0, 1.0, -1.0)
        bends = [np.interp(abs(w), curve, _TABLE) for w, curve in zip(wanted, self._curves)]
        sticks = _MIDDLE + np.sign(wanted) * (self._dead + bends * (_HALF - self._dead))
        exact = np.array(
            [sticks[0], sticks[1], self._lowest + throttle * (_HIGH - self._lowest), sticks[2]]
        )
        whole = np.clip(np.rint(exact + self._left), _LOW, _HIGH)
        self._left = np.clip(exact + self._left - whole, -1.0, 1.0)
        channels = self.at_rest(armed=True)
        channels[:4] = whole.astype(int).tolist()
        return channels

    def rotor_speeds(self, outputs: np.ndarray) -> np.ndarray:
        """Returns the rotor speeds (rad/s) that speed controllers are to reach, (4,).

        Their speed is proportional to what they get; the lag is that of the rotors.

        Args: outputs: to Betaflight's motors, 1000 to 2000, (16,).
        """
        shares = np.clip((outputs[self._order] - _LOW) / (_HIGH - _LOW), 0.0, 1.0)
        return shares * self._max_speeds


def _motors_of(vehicle: Vehicle) -> list[int]:
    """Returns for each rotor which of Betaflight's motors it is, from 0."""
    places = [tuple(np.sign(rotor.position[:2]).astype(int)) for rotor in vehicle.rotors]
    if sorted(places) != sorted(_PLACES):
        raise UserError(
            f"Betaflight flies quadrotors whose arms make an X, which the {vehicle.name} is not: "
            "race it with `--flight_controller internal`."
        )
    return [_PLACES.index(place) for place in places]


def _check_directions(vehicle: Vehicle, order: list[int], is_reversed: bool) -> None:
    """Refuses rotors that turn the other way: yaw would run away.

    Args: order: see _motors_of(). is_reversed: whether motor 1 turns counter-clockwise.
    """
    first, second = ("ccw", "cw") if is_reversed else ("cw", "ccw")
    expected = first, second, second, first
    if any(rotor.direction != expected[i] for rotor, i in zip(vehicle.rotors, order)):
        raise UserError(
            f"The rotors of the {vehicle.name} do not turn as Betaflight's settings say: change "
            "yaw_motors_reversed."
        )


def _rates(axis: str, values: Mapping[str, str]) -> np.ndarray:
    """Returns the rates (deg/s) for the deflections of the table; see rates_type ACTUAL."""
    if values["rates_type"] != "ACTUAL":
        raise UserError(
            f"Betaflight's settings have rates_type = {values['rates_type']}: set it to ACTUAL."
        )
    centre, most = (10.0 * float(values[f"{axis}_{name}"]) for name in ("rc_rate", "srate"))
    expo = float(values[f"{axis}_expo"]) / 100.0
    bend = _TABLE * (_TABLE**5 * expo + _TABLE * (1.0 - expo))
    return _TABLE * centre + max(0.0, most - centre) * bend


def _arm_channel(dump: str) -> tuple[int, int]:
    """Returns the index of the channel that arms, and the value that does."""
    for channel, low, high in _ARM.findall(dump):
        if int(low) < int(high):
            return 4 + int(channel), min(_HIGH, (int(low) + int(high)) // 2)
    raise UserError(
        "Betaflight's settings have no channel that arms: add the line `aux 0 0 0 1700 2100 0 0`."
    )
