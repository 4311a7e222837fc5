"""How the firmware's rate loop answers a step: what a team looks at when it tunes one."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airrace.betaflight.firmware import Firmware, find_firmware
from airrace.betaflight.firmware_process import PERIOD, FirmwareProcess
from airrace.betaflight.settings import FILE_NAME, configure
from airrace.betaflight.sticks import Sticks, power_on
from airrace.common.files import write_text
from airrace.common.held_folders import temporary_folder
from airrace.scenario.imu_config import ImuConfig
from airrace.vehicle import GRAVITY, Vehicle, find_vehicle, load_vehicle
from airrace.vehicle.rotors import make_rotor_dynamics, next_speed

AXES = "roll", "pitch", "yaw"
_ARMING = 0.5  # s
_SETTLING = 0.2  # s, before the step, in which the rotors come to their speeds
_SHARES = 0.63, 0.9


class StepResponse(NamedTuple):
    """A step of one axis, each millisecond from it on."""

    size: float  #: of the step (rad/s)
    times: np.ndarray  #: since the step (s), (n,)
    rates: np.ndarray  #: of the axis (rad/s), (n,)
    outputs: np.ndarray  #: what the motors get, 1000 to 2000, (n, number of motors)

    @property
    def rise_times(self) -> tuple[float, float]:
        """When 63 % and 90 % were reached (s); infinity if they were not."""
        return tuple(  # type: ignore[return-value]
            float(self.times[reached.argmax()]) if reached.any() else np.inf
            for reached in (self.rates >= share * self.size for share in _SHARES)
        )

    @property
    def overshoot(self) -> float:
        """By what share of the step the rate went beyond it."""
        return max(0.0, float(self.rates.max()) / self.size - 1.0)

    @property
    def trembling(self) -> float:
        """How much of what motors get changes from one step to the next, of 1000: its mean."""
        return float(np.abs(np.diff(self.outputs, axis=0)).mean())


def fly_step(
    changes: str = "",
    *,
    axis: str = "roll",
    size: float = 3.0,
    duration: float = 0.6,
    imu: str = "ideal",
    drone: str = "Default",
    seed: int = 0,
) -> StepResponse:
    """Flies a step of a rate: of a free body with a drone's inertia and rotors, as in a hover.

    Args:
        changes: lines for the firmware's command line, after those of the drone's betaflight.txt.
        axis: roll, pitch or yaw. size: of the step (rad/s). duration: after it (s).
        imu: preset of the noise, see ImuConfig. seed: of that.
        drone: see load_vehicle().

    Raises:
        UserError: if there is no firmware, or it does not take the settings.
    """
    firmware, (vehicle, _) = find_firmware(), load_vehicle(drone)
    errors = ImuConfig(preset=imu).resolved()
    noise = np.repeat((errors.gyro_noise, errors.accelerometer_noise), 3) / np.sqrt(PERIOD)
    rng = np.random.default_rng(seed)
    with temporary_folder() as folder:
        shipped = find_vehicle(drone).with_name(FILE_NAME).read_text(encoding="utf-8")
        source = folder / FILE_NAME
        write_text(source, f"{shipped}\n{changes}\n")
        dump, _ = configure(firmware, source, folder)
        sticks = Sticks(dump, vehicle)
        with contextlib.closing(start_armed(firmware, folder, sticks)) as process:
            step = axis, size, duration
            return _fly(process, sticks, vehicle, step, lambda: rng.normal(0.0, noise))


def start_armed(firmware: Firmware, folder: Path, sticks: Sticks) -> FirmwareProcess:
    """Starts a firmware whose settings are in a folder, and arms it.

    Args: sticks: of the settings.
    """
    process = FirmwareProcess(firmware, folder)
    power_on(process, sticks, _ARMING)
    return process


def _fly(
    process: FirmwareProcess,
    sticks: Sticks,
    vehicle: Vehicle,
    step: tuple[str, float, float],
    noise: Callable[[], np.ndarray],
) -> StepResponse:
    """Flies it. Args: process: armed. step: axis, size, duration. noise: makes that of an IMU."""
    axis, size, duration = step
    rotors, inertia = make_rotor_dynamics(vehicle, PERIOD), np.array(vehicle.inertia)
    hover = vehicle.mass * GRAVITY
    speeds = np.sqrt(hover / len(vehicle.rotors) / vehicle.thrust_coefficients)
    command, w, flown = np.array((hover, 0.0, 0.0, 0.0)), np.zeros(3), []
    begin = round(_SETTLING / PERIOD)
    for i in range(begin + round(duration / PERIOD)):
        if i == begin:
            command[1 + AXES.index(axis)] = size
        f, *moment = vehicle.allocation @ (vehicle.thrust_coefficients * np.square(speeds))
        imu = np.array((*w, 0.0, 0.0, f / vehicle.mass)) + noise()
        outputs = process.step(sticks.channels(command), imu)
        w = w + PERIOD * (np.array(moment) - np.cross(w, inertia * w)) / inertia
        speeds = np.array(
            [
                next_speed(speed, wanted, most, rotors.step_share)
                for speed, wanted, most in zip(
                    speeds, sticks.rotor_speeds(outputs), rotors.max_speeds
                )
            ]
        )
        flown.append((w[AXES.index(axis)], *outputs[: sticks.rotors]))
    values = np.array(flown[begin:])
    return StepResponse(size, PERIOD * np.arange(len(values)), values[:, 0], values[:, 1:])
