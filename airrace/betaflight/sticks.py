"""From thrust and body rates to the sticks of a radio, and from motor outputs to rotor speeds."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Set
from typing import ClassVar

import numpy as np

from airrace.betaflight.firmware_process import CHANNELS, LEVEL, NO_RADIO, REST, FirmwareProcess
from airrace.betaflight.settings import values_of
from airrace.common.errors import UserError
from airrace.common.jit import compilable, compiled
from airrace.vehicle import Vehicle

BOOT = 0.5  # s, of the firmware's time, before its radio is on
CALIBRATION = 5.5  # s, in which it learns what its gyroscope shows at rest, and a reserve
_LOW, _MIDDLE, _HIGH = 1000, 1500, 2000
_NO_SIGNAL = 800  # below rx_min_usec
_HALF = _HIGH - _MIDDLE
_TABLE = np.linspace(0.0, 1.0, 1001)  # deflections of a stick
_AXES = "roll", "pitch", "yaw"
_MOTOR_CURVE = {"motor_idle": 1e4, "thrust_linear": 1e2}  # by how much they are more than a share
_NEEDED = (
    {"yaw_motors_reversed", "min_check", "deadband", "yaw_deadband"}
    | _MOTOR_CURVE.keys()
    | {f"{axis}_{name}" for axis in _AXES for name in ("rc_rate", "srate", "expo")}
)
_MODE = re.compile(r"^aux \d+ (\d+) (\d+) (\d+) (\d+)", re.MULTILINE)
_ARM = 0  # number of the mode
Read = Callable[[], np.ndarray]  # reads a vector that not all sticks need: that takes time
# Of Betaflight's motors 1 to 4: where they are seen from above, ahead and to the left. Motors 5
# to 8 are under them.
_PLACES = ((-1, -1), (1, -1), (-1, 1), (1, 1))
_MIXERS = {4: "QUADX", 8: "OCTOX8"}  # by the number of motors


class Sticks:
    """What the settings make of sticks, and so which sticks make what is wanted.

    Attributes:
        rotors: how many there are.
    """

    # Settings of which only one value can be flown: the loop is to get just what is commanded.
    _ONLY: ClassVar[Mapping[str, str]] = {
        "rates_type": "ACTUAL",
        "thr_expo": "0",
        "throttle_limit_type": "OFF",
        "rc_smoothing": "OFF",
        **{f"f_{axis}": "0" for axis in _AXES},
    }
    _MODES: ClassVar[Mapping[int, str]] = {_ARM: "arms"}  # what their channels do, by their numbers

    def __init__(self, dump: str, vehicle: Vehicle):
        """Args: dump: the settings, see configure(). vehicle: the drone.

        Raises:
            UserError: if the settings cannot be flown by thrust and rates, or not this drone.
        """
        values = needed_values(dump, _NEEDED | self._ONLY.keys())
        self._order = _motors_of(vehicle)
        self.rotors = len(self._order)
        if missing := [*self._missing_lines(dump, values, vehicle)]:
            raise UserError(
                f"Betaflight's settings cannot fly the {vehicle.name}: add {', '.join(missing)}."
            )
        self._max_speeds = vehicle.max_speeds
        self._most = float(vehicle.max_thrusts.sum())
        motors = _motor_speeds(*(int(values[n]) / w for n, w in _MOTOR_CURVE.items()))
        self._curves = np.array([*(_rates(axis, values) for axis in _AXES), motors])
        names = "deadband", "deadband", "yaw_deadband", "min_check"
        self._limits = np.array([*(float(values[name]) for name in names), self._most])
        self._switches = (CHANNELS - 4) * [_LOW]  # what the other channels are, when it is armed
        for mode in self._MODES:
            channel, position = _switches(dump)[mode]
            self._switches[channel] = position
        self._arm = 4 + _switches(dump)[_ARM][0]
        self._whole = np.zeros(4, int)
        self._left = np.zeros(4)  # of what was wanted, that whole numbers could not say yet

    def _missing_lines(
        self, dump: str, values: Mapping[str, str], vehicle: Vehicle
    ) -> Iterator[str]:
        """Yields the lines that settings lack, so that they can be flown."""
        mixer = f"mixer {_MIXERS[self.rotors]}"
        if f"\n{mixer}\n" not in f"\n{dump}":
            yield f"`{mixer}`"
        only = {**self._ONLY, "yaw_motors_reversed": _reversal(vehicle, self._order)}
        for name, value in only.items():
            if values[name] != value:
                yield f"`set {name} = {value}` (it is {values[name]})"
        for mode, what in self._MODES.items():
            if mode not in _switches(dump):
                yield f"`aux {mode} {mode} {mode} 1700 2100 0 0` (a channel that {what})"

    def at_rest(self, armed: bool) -> list[int]:
        """Returns channels of the radio, with its throttle down."""
        channels = [_MIDDLE, _MIDDLE, _LOW, _MIDDLE, *self._switches]
        if not armed:
            channels[self._arm] = _LOW
        return channels

    def shown_attitude(self, read_state: Read) -> np.ndarray:
        """Returns the attitude that the firmware is told, see begin_step(); here, it uses none.

        Args: read_state: returns the plant's, the true one, (13,).
        """
        return LEVEL

    def command_of(self, rates: np.ndarray, read_estimate: Read) -> np.ndarray:
        """Returns what channels() takes, (4,), for thrust and rates; here, these themselves.

        Args: rates: [f, w_x, w_y, w_z], total thrust (N) and rates in B (rad/s), (4,).
        read_estimate: returns the vector of the drone's estimated State, (14,).
        """
        return rates

    def no_signal(self) -> list[int]:
        """Returns channels of a radio that hears nothing: no value that a stick could have."""
        return CHANNELS * [_NO_SIGNAL]

    def channels_of_thrust(self, share: float) -> list[int]:
        """Returns channels for a share of the greatest thrust, with the other sticks at rest."""
        channels = self.channels(np.array((share * self._most, 0.0, 0.0, 0.0)))
        self._left[:] = 0.0
        return channels

    def channels(self, command: np.ndarray, supply: float = 1.0) -> list[int]:
        """Returns the radio's channels for a command.

        They are whole numbers; what is lost by that is added to the next command, so that on
        average nothing is.

        Args:
            command: see command_of(), (4,).
            supply: the battery's voltage, see Pack.
        """
        _set_sticks(self._whole, self._left, command, supply, self._curves, self._limits)
        return [*self._whole.tolist(), *self._switches]

    def rotor_speeds(self, outputs: np.ndarray, supply: float = 1.0) -> np.ndarray:
        """Returns the rotor speeds (rad/s) that the motors make for, (n,).

        They are proportional to what their controllers get, and to the voltage; the lag is that of
        the rotors.

        Args: outputs: to Betaflight's motors, 1000 to 2000, (16,). supply: see channels().
        """
        speeds = np.empty(len(self._order))
        _set_speeds(speeds, outputs, self._order, self._max_speeds, supply)
        return speeds


def power_on(
    process: FirmwareProcess, sticks: Sticks, arming: float, imu: np.ndarray = REST
) -> None:
    """Lets a firmware start, calibrate and arm, on a drone that stands.

    Args: sticks: of its settings. arming: for how long the switch is raised (s). imu: at rest, see
    state_packet().
    """
    process.hold(BOOT, NO_RADIO, imu)
    process.hold(CALIBRATION, sticks.at_rest(armed=False), imu)
    process.hold(arming, sticks.at_rest(armed=True), imu)


@compiled
def _set_sticks(
    whole: np.ndarray,
    left: np.ndarray,
    command: np.ndarray,
    supply: float,
    curves: np.ndarray,
    limits: np.ndarray,
) -> None:
    """Sets the sticks roll, pitch, throttle and yaw, (4,), and what whole numbers lose.

    Args:
        whole: the sticks. left: what they have lost so far, (4,). Both are written.
        command, supply: see Sticks.channels().
        curves: what deflections of the sticks ask for, by _TABLE, (4, n): rates (deg/s), and the
            share of their greatest speed at which motors turn.
        limits: deadbands of roll, pitch, yaw, lowest throttle, and greatest thrust (N), (5,).
    """
    lowest, most = limits[3], limits[4]
    # Thrust goes with the square of a rotor's speed.
    speed = math.sqrt(min(max(command[0] / most, 0.0), 1.0)) / supply
    for i in range(4):
        axis = (0, 1, 3, 2)[i]  # of curves and commands: roll, pitch, throttle, yaw
        if i == 2:
            exact = lowest + _deflection(curves[axis], speed) * (_HIGH - lowest)
        else:
            # Sticks to the right and ahead: roll to the right, nose down, yaw to the right.
            wanted = math.degrees(command[1 + axis]) * (-1.0 if axis == 2 else 1.0)
            dead = limits[axis] if wanted != 0.0 else 0.0
            off = dead + _deflection(curves[axis], abs(wanted)) * (_HALF - dead)
            exact = _MIDDLE + math.copysign(off, wanted)
        exact += left[i]
        rounded = min(max(np.rint(exact), float(_LOW)), float(_HIGH))
        whole[i] = int(rounded)
        left[i] = min(max(exact - rounded, -1.0), 1.0)


@compilable
def _deflection(curve: np.ndarray, value: float) -> float:
    """Returns where a rising curve over _TABLE, (n,), has a value, from 0 to 1."""
    last = len(curve) - 1
    if value <= curve[0]:
        return 0.0
    if value >= curve[last]:
        return 1.0
    i = np.searchsorted(curve, value)
    return (i - 1 + (value - curve[i - 1]) / (curve[i] - curve[i - 1])) / last


@compiled
def _set_speeds(
    speeds: np.ndarray,
    outputs: np.ndarray,
    order: np.ndarray,
    max_speeds: np.ndarray,
    supply: float,
) -> None:
    """Sets rotor speeds (rad/s), (n,); see Sticks.rotor_speeds(), and _motors_of() of order."""
    for i in range(len(speeds)):
        share = (outputs[order[i]] - _LOW) / (_HIGH - _LOW)
        speeds[i] = min(max(share, 0.0), 1.0) * max_speeds[i] * supply


def _motor_speeds(idle: float, linear: float) -> np.ndarray:
    """Returns the share of their greatest speed at which motors turn, for throttles of the table.

    Speed is proportional to what a motor gets, from idle on. Betaflight bends that, so that thrust
    comes closer to a straight line at a low throttle: see its pidCompensateThrustLinearization()
    and pidApplyThrustLinearization().

    Args: idle: motor_idle, as a share. linear: thrust_linear, as a share.
    """
    mixed = _TABLE / (1.0 + (linear - 0.5 * linear**2) * (1.0 - _TABLE) ** 2)
    return idle + (1.0 - idle) * mixed * (1.0 + linear * (1.0 - mixed) ** 2)


def _motors_of(vehicle: Vehicle) -> np.ndarray:
    """Returns for each rotor which of Betaflight's motors it is, from 0, (n,)."""
    places = [tuple(np.sign(rotor.position[:2]).astype(int)) for rotor in vehicle.rotors]
    # Of two rotors at a place, the lower one is under the other.
    tops = [
        max(r.position[2] for p, r in zip(places, vehicle.rotors) if p == place) for place in places
    ]
    order = [
        _PLACES.index(place) + len(_PLACES) * (rotor.position[2] < top) if place in _PLACES else -1
        for place, rotor, top in zip(places, vehicle.rotors, tops)
    ]
    if sorted(order) not in ([*range(n)] for n in _MIXERS):
        raise UserError(
            f"Betaflight flies four or eight rotors on arms that make an X, which the "
            f"{vehicle.name} has not: race it with `--flight_controller internal`."
        )
    return np.array(order)


def _reversal(vehicle: Vehicle, order: np.ndarray) -> str:
    """Returns what yaw_motors_reversed must be: with the other value, yaw would run away.

    It is ON where motor 1 turns counter-clockwise. Args: order: see _motors_of().
    """
    directions = [vehicle.rotors[i].direction for i in np.argsort(order)]
    first, second = directions[:2]
    # A rotor under another turns against it.
    expected = [first, second, second, first, second, first, first, second]
    if first == second or directions != expected[: len(directions)]:
        raise UserError(
            f"The rotors of the {vehicle.name} do not turn as Betaflight's mixers take them to: "
            "race it with `--flight_controller internal`."
        )
    return "ON" if first == "ccw" else "OFF"


def _switches(dump: str) -> dict[int, tuple[int, int]]:
    """Returns of each mode the first channel that switches it on, from 0, and its value then."""
    found = [(*map(int, each),) for each in _MODE.findall(dump)]
    return {
        mode: (channel, min(_HIGH, (low + high) // 2))
        for mode, channel, low, high in reversed(found)
        if low < high
    }


def _rates(axis: str, values: Mapping[str, str]) -> np.ndarray:
    """Returns the rates (deg/s) for the deflections of the table; see rates_type ACTUAL."""
    centre, most = (10.0 * float(values[f"{axis}_{name}"]) for name in ("rc_rate", "srate"))
    expo = float(values[f"{axis}_expo"]) / 100.0
    bend = _TABLE * (_TABLE**5 * expo + _TABLE * (1.0 - expo))
    return _TABLE * centre + max(0.0, most - centre) * bend


def needed_values(dump: str, names: Set[str]) -> dict[str, str]:
    """Returns the values that a dump sets, by name; raises UserError if some names are missing."""
    values = values_of(dump)
    if missing := names - values.keys():
        raise UserError(
            f"Betaflight's settings do not say {', '.join(sorted(missing))}: it is another "
            "Betaflight than the one of `airrace betaflight build`."
        )
    return values
