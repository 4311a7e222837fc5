"""A race in which the firmware drives the motors: how it is joined, and prepared for take-off."""

import contextlib
import dataclasses as dc
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.framework import DiagramBuilder

from airrace.analysis.blackbox import FILE as LOG_NAME
from airrace.analysis.blackbox import RACE_BEGINS
from airrace.betaflight.angle_mode import AngleSticks
from airrace.betaflight.betaflight_system import Betaflight
from airrace.betaflight.firmware import find_firmware
from airrace.betaflight.firmware_process import PERIOD, REST, FirmwareProcess
from airrace.betaflight.settings import FILE_NAME, configure, state_of_arming
from airrace.betaflight.sticks import BOOT, CALIBRATION, Sticks, power_on
from airrace.common.errors import UserError, words
from airrace.common.files import write_text
from airrace.common.held_folders import temporary_folder
from airrace.common.words import count, printable
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.transport import Transport
from airrace.diagrams.wiring import connect_by_name, export_inputs, inputs_of, outputs_of
from airrace.scenario import BETAFLIGHT
from airrace.systems.sensing.imu import Imu
from airrace.vehicle import find_vehicle, load_vehicle
from airrace.vehicle.battery import Pack
from airrace.vehicle.imu_errors import turn_on_biases
from airrace.vehicle.sensor_failures import RadioFailure

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import Diagram, System

    from airrace.scenario import Scenario
    from airrace.systems.types import RefereeStatus

_ARMING = 0.3  # s
_TRY = 0.1  # s, for which they are
_TRY_THRUST = 0.01  # share of the greatest: too little for airmode
_DISARMING = 0.5  # s, in which the firmware ends its log
_SPEEDS = "rotor_speeds"
_LOGS = "LOG*.BF*"  # as the firmware calls them: it cuts the L off
_HOLD = 0.3  # s, for which Betaflight keeps what it heard last
_LONG = 1e9  # s
_SHOWN = 3  # refused lines; all of them are in the race's folder
STICKS = {"rates": Sticks, "angle": AngleSticks}  # by betaflight_mode of a scenario


@contextlib.contextmanager
def join_betaflight(
    scenario: "Scenario", output_dir: Path, note: Callable[[str], object]
) -> Iterator["BetaflightTransport"]:
    """Starts the firmware with its settings; yields what joins it to a race.

    Its settings, as it has them, are left in the race's folder, below the lines that it refused.

    Args: scenario: the race. output_dir: its folder. note: shows a line.

    Raises:
        UserError: if the firmware or its settings cannot be had, or cannot fly this drone; after
            the race, if the firmware ended before it.
    """
    firmware = find_firmware()
    vehicle, _ = load_vehicle(scenario.drone)
    source = find_settings(scenario)
    with temporary_folder() as folder:
        dump, refused = configure(firmware, source, folder)
        sticks = STICKS[scenario.betaflight_mode](dump, vehicle)
        kept = output_dir / FILE_NAME
        not_taken = f"Betaflight does not take {count(len(refused), 'line')} of {source}"
        comments = [printable(not_taken), *refused] if refused else []
        write_text(kept, "".join(f"# {line}\n" for line in comments) + dump)
        if refused:
            shown = ", ".join(map(str, refused[:_SHOWN]))
            more = len(refused) - _SHOWN
            note(f"{not_taken}: {shown}" + (f", and {more} more, see {kept}" if more > 0 else ""))
        try:
            with contextlib.closing(FirmwareProcess(firmware, folder)) as process:
                yield BetaflightTransport(process, sticks, note)
        finally:
            _keep_log(folder, output_dir, note)
    if process.problem is not None:
        raise UserError(f"{process.problem}; what was flown before is in {output_dir}.")


def _keep_log(folder: Path, output_dir: Path, note: Callable[[str], object]) -> None:
    """Copies the firmware's log of its flight, if it wrote one, to a race's folder."""
    try:
        for log in sorted(folder.glob(_LOGS))[-1:]:
            shutil.copy(log, output_dir / LOG_NAME)
    except OSError as e:
        note(f"There is no {LOG_NAME} ({words(e)})")


def find_settings(scenario: "Scenario") -> Path:
    """Returns the file of the firmware's settings.

    Raises:
        UserError: if there is none.
    """
    if scenario.betaflight_config:
        return Path(scenario.betaflight_config)
    path = find_vehicle(scenario.drone).parent / FILE_NAME
    if not path.is_file():
        raise UserError(
            f"There are no settings of Betaflight for this drone, {path}: name a file with "
            "--betaflight_config."
        )
    return path


class BetaflightTransport(Transport):
    """Joins a simulation to an autonomy and to the firmware, which drives the motors."""

    simulation = "SITL"
    flight_controllers = (BETAFLIGHT,)

    def __init__(self, process: FirmwareProcess, sticks: Sticks, note: Callable[[str], object]):
        """Constructs the transport.

        Args:
            process: of the firmware, just started.
            sticks: what its settings make of them.
            note: shows a line.
        """
        self._process, self._sticks, self._note = process, sticks, note
        self._rest = REST
        self._failures: list[RadioFailure] = []

    def AddToBuilder(
        self, builder: "DiagramBuilder", scenario: "Scenario", simulation: "Diagram"
    ) -> "System":
        self._failures = scenario.radio_failures
        self._rest = REST + turn_on_biases(scenario.imu.resolved(), scenario.seed)
        flown = builder.AddSystem(self._make_flown(scenario))
        connect_by_name(builder, [flown], outputs_of(simulation))
        connect_by_name(builder, [simulation], outputs_of(flown))
        return flown

    def _make_flown(self, scenario: "Scenario") -> "Diagram":
        """Returns the autonomy with the flight controller that it commands, which has an IMU."""
        builder = DiagramBuilder()
        autonomy = builder.AddSystem(MakeAutonomy(scenario))
        vehicle, _ = load_vehicle(scenario.drone)
        imu = Imu(
            rate=1.0 / PERIOD,
            errors=scenario.imu.resolved(),
            position=vehicle.imu.position,
            failures=scenario.imu_failures,
            seed=scenario.seed,
            state_period=scenario.plant_config.time_step,
        )
        betaflight = Betaflight(
            process=self._process,
            sticks=self._sticks,
            failures=scenario.radio_failures,
            pack=Pack(vehicle.battery, vehicle) if vehicle.battery else None,
            hears_voltage=vehicle.battery is None or vehicle.battery.heard,
        )
        builder.AddNamedSystem("flight_controllers_imu", imu)
        builder.AddNamedSystem("betaflight", betaflight)
        builder.Connect(imu.GetOutputPort("imu"), betaflight.GetInputPort("imu"))
        builder.Connect(
            autonomy.GetOutputPort("rate_command"), betaflight.GetInputPort("rate_command")
        )
        builder.Connect(
            autonomy.GetOutputPort("filtered_estimate"),
            betaflight.GetInputPort("filtered_estimate"),
        )
        builder.ExportInput(imu.GetInputPort("state"), "truth.state")
        builder.ConnectInput("truth.state", betaflight.GetInputPort("state"))
        inputs = {n: [autonomy.GetInputPort(n)] for n in inputs_of(autonomy)}
        inputs.setdefault(_SPEEDS, []).append(betaflight.GetInputPort(_SPEEDS))
        export_inputs(builder, inputs)
        for name, port in outputs_of(autonomy, betaflight).items():
            builder.ExportOutput(port, name)
        diagram = builder.Build()
        diagram.set_name("autonomy")
        return diagram

    def begin(self, simulator: "Simulator") -> None:
        """Lets the firmware start, calibrate and arm, on a drone that stands.

        Raises:
            UserError: if it does not arm.
        """
        process, sticks = self._process, self._sticks
        small = sticks.channels_of_thrust(_TRY_THRUST)
        power_on(process, sticks, _ARMING, self._rest)
        outputs = process.hold(_TRY, small, self._rest)
        if process.problem is not None:
            raise UserError(f"{process.problem}, before it was armed.")
        if not sticks.rotor_speeds(outputs).all():
            raise UserError(
                f"Betaflight does not arm ({state_of_arming(process)}): change its settings."
            )
        # Its clock has begun with its first step, so its log can be put beside the race's.
        left = RACE_BEGINS - (BOOT + CALIBRATION + _ARMING + _TRY)
        process.hold(left, sticks.at_rest(armed=True), self._rest)
        if simulator.get_target_realtime_rate() > 0.0:
            self._note(f"Betaflight's MSP and command line are at tcp://127.0.0.1:{process.port}")

    def advance(self, simulator: "Simulator", time: float) -> str | None:
        simulator.AdvanceTo(time)
        return self._process.problem

    def judged(self, status: "RefereeStatus", simulator: "Simulator") -> "RefereeStatus":
        silent = [failure.time for failure in self._failures if _acted(failure, status)]
        if status.dnf_reason is None or not silent:
            return status
        why = f"Betaflight's failsafe acted: it heard no commands from {silent[-1]:.1f} s on"
        return dc.replace(status, dnf_reason=f"{status.dnf_reason}: {why}")

    def end(self, simulator: "Simulator") -> None:
        """Disarms."""
        self._process.hold(_DISARMING, self._sticks.at_rest(armed=False), self._rest)


def _acted(failure: RadioFailure, status: "RefereeStatus") -> bool:
    """Whether a failure has lasted long enough for the failsafe when the race ended."""
    time = min(status.end_time or 0.0, failure.time + (failure.duration or _LONG))
    return time - failure.time > _HOLD
