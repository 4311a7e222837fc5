"""The flight controller's watchdog before a simulation's rotors, with a controller of its own."""

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from airrace.diagrams.estimators import make_strapdown_integrator
from airrace.diagrams.wiring import connect_by_name, outputs_of
from airrace.scenario import Scenario
from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.estimation.state_filter import StateFilter
from airrace.systems.failsafe.command_watchdog import CommandWatchdog
from airrace.systems.failsafe.rotor_monitor import RotorMonitor
from airrace.vehicle import load_vehicle

_COMMANDS = ("rotor_speed_command", "rotor_speed_command_time")


def AddCommandWatchdog(
    builder: DiagramBuilder, scenario: Scenario, simulation: Diagram, link: System
) -> CommandWatchdog:
    """Adds a watchdog, with a controller of its own, before a simulation's rotors.

    Args:
        builder: of the race.
        scenario: the race.
        simulation: its diagram, whose input ``rotor_speed_command`` is connected.
        link: has the output ports ``rotor_speed_command`` and ``..._time``; with the estimator
            ``vio`` also ``corrections``: nobody tells the flight controller either where it is, so
            it goes on by its inertial sensor from the last correction that came.
    """
    vehicle, rate = load_vehicle(scenario.drone)[0], scenario.controller.rate
    add = builder.AddNamedSystem
    watchdog = add("command_watchdog", CommandWatchdog(rotors=len(vehicle.rotors), rate=rate))
    monitor = add("own_rotor_monitor", RotorMonitor.from_scenario(scenario))
    controller = add("own_controller", GeometricController(vehicle=vehicle, rate=rate))
    if scenario.localizes:
        estimator = add("own_strapdown_integrator", make_strapdown_integrator(scenario))
    else:
        estimator = add("own_state_filter", StateFilter.from_scenario(scenario))
    commands = {name: link.GetOutputPort(name) for name in _COMMANDS}
    own = {"own_command": controller.get_output_port()}
    told = outputs_of(monitor, estimator, simulation, link)
    connect_by_name(builder, [watchdog], {**told, **commands, **own})
    connect_by_name(builder, [monitor, estimator, controller], outputs_of(watchdog) | told)
    builder.Connect(
        watchdog.GetOutputPort("rotor_speed_command"),
        simulation.GetInputPort("rotor_speed_command"),
    )
    return watchdog
