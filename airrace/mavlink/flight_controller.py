"""What stands in the place of the autonomy when a client flies: its bridge, and who obeys it."""

from typing import TYPE_CHECKING

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from airrace.diagrams.wiring import connect_by_name, export_inputs, outputs_of
from airrace.mavlink.bridge import MavlinkBridge
from airrace.scenario import Scenario
from airrace.systems.control.attitude_controller import AttitudeController
from airrace.systems.control.motor_switch import MotorSwitch
from airrace.systems.control.rate_controller import RateController
from airrace.systems.control.velocity_controller import VelocityController
from airrace.systems.failsafe.setpoint_watchdog import SetpointWatchdog
from airrace.systems.sensing.state_estimate import TrueEstimate
from airrace.track import Course, start_pose
from airrace.vehicle import Vehicle

if TYPE_CHECKING:
    from airrace.mavlink.client_link import ClientLink

_STANDING = 0.08  # m, about; LOCAL_NED begins there


def MakeFlightController(
    scenario: Scenario,
    track: Course,
    vehicle: Vehicle,
    link: "ClientLink",
    before: float | None = None,
) -> Diagram:
    """Builds the MavlinkBridge and the controllers that do what its client says.

    They are a cascade: VelocityController, AttitudeController, RateController, each of which
    hands on what is not for it, and MotorSwitch. As in the official simulator, they know the
    truth; the client is told what the scenario's ``mavlink.vq`` allows.

    Input ports: the Simulation's outputs that MavlinkBridge takes. Output ports:
    ``rotor_speed_command`` and ``explorer_status``.
    """
    builder = DiagramBuilder()
    start = start_pose(track.start, vehicle.radius, _STANDING).translation()
    bridge = builder.AddNamedSystem(
        "mavlink_bridge",
        MavlinkBridge(
            scenario=scenario, track=track, vehicle=vehicle, start=start, link=link, before=before
        ),
    )
    rate_controller = RateController(vehicle=vehicle, rate=scenario.controller.rate)
    switch = MotorSwitch(vehicle=vehicle)
    systems: dict[str, System] = {
        "true_estimate": TrueEstimate(),
        "setpoint_watchdog": SetpointWatchdog(standing_height=start[2]),
        "velocity_controller": VelocityController(vehicle=vehicle),
        "attitude_controller": AttitudeController(vehicle=vehicle),
        "rate_controller": rate_controller,
        "motor_switch": switch,
    }
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    sources = outputs_of(bridge, *systems.values())
    # The switch has the last word on what the controller commands.
    sources["controlled_speeds"] = rate_controller.get_output_port()
    export_inputs(builder, connect_by_name(builder, [bridge, *systems.values()], sources))
    builder.ExportOutput(switch.get_output_port(), "rotor_speed_command")
    builder.ExportOutput(bridge.GetOutputPort("explorer_status"), "explorer_status")
    diagram = builder.Build()
    diagram.set_name("flight_controller")
    return diagram
