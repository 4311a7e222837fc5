"""A flight without a race: the simulated world, and only what controls the drone."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import Value
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantValueSource

from airrace.diagrams.autonomy import make_system
from airrace.diagrams.simulation import MakeSimulation
from airrace.scenario import Scenario
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import GRAVITY, load_vehicle

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

CONTROL = ("rotor_monitor", "state_filter", "geometric_controller")


class ReferenceSource(LeafSystem):
    """Evaluates a function of time as the controller's reference.

    .. pydrake_system::

        name: ReferenceSource
        output_ports:
        - reference
    """

    def __init__(self, reference: Callable[[float], np.ndarray]):
        """Args: reference: time (s) to the vector of trajopt/reference.py."""
        LeafSystem.__init__(self)
        self.DeclareVectorOutputPort(
            "reference",
            REFERENCE_SIZE,
            lambda context, output: output.set_value(reference(context.get_time())),
            {self.time_ticket()},
        )


def MakeFlight(scenario: Scenario, reference: Callable[[float], np.ndarray]) -> Diagram:
    """Builds a flight along a reference, in the scenario's world.

    It consists of the Simulation, whose camera is not read, and of the systems of
    CONTROL, as in the Autonomy. Its outputs are ``truth.state``,
    ``truth.referee_status``, ``rotor_speeds`` and ``rotor_losses``.

    Args:
        scenario: of which track, drone, disturbances, failures, noise, and
            the systems of CONTROL matter.
        reference: time (s) to the vector of trajopt/reference.py, (18,).
    """
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario))
    systems = [builder.AddNamedSystem(name, make_system(name, scenario)) for name in CONTROL]
    source = builder.AddNamedSystem("reference_source", ReferenceSource(reference))
    status = builder.AddSystem(ConstantValueSource(Value[object](ExplorerStatus(done=True))))
    builder.Connect(status.get_output_port(), simulation.GetInputPort("explorer_status"))
    for system in (simulation, *systems):
        for i in range(system.num_input_ports()):
            name = system.get_input_port(i).get_name()
            for producer in (simulation, source, *systems):
                if producer.HasOutputPort(name) and not name.startswith("truth."):
                    builder.Connect(producer.GetOutputPort(name), system.get_input_port(i))
    for system, name in (
        (simulation, "truth.state"),
        (simulation, "truth.referee_status"),
        (simulation, "rotor_speeds"),
        (systems[0], "rotor_losses"),
    ):
        builder.ExportOutput(system.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("flight")
    return diagram


def start_in_flight(
    flight: Diagram,
    scenario: Scenario,
    context: Context,
    *,
    X_WB: "RigidTransform",
    w_WB: ArrayLike = (0, 0, 0),
    v_WB: ArrayLike = (0, 0, 0),
) -> None:
    """Puts the drone into the air, its rotors turning as in a hover.

    Args:
        flight: from MakeFlight().
        scenario: of the flight.
        context: of the flight.
        X_WB: pose of the drone.
        w_WB, v_WB: angular velocity (rad/s) and velocity (m/s), in the world.
    """
    simulation = flight.GetSubsystemByName("simulation")
    plant = simulation.GetSubsystemByName("plant")
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetFloatingBaseBodyPoseInWorldFrame(plant_context, plant.GetBodyByName("body"), X_WB)
    plant.SetVelocities(plant_context, np.concatenate([w_WB, v_WB]))
    vehicle, _ = load_vehicle(scenario.drone)
    wrench = [vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
    speeds = np.sqrt(np.linalg.pinv(vehicle.allocation) @ wrench / vehicle.thrust_coefficients)
    rotors = simulation.GetSubsystemByName("rotor_bank")
    rotors.set_speeds(rotors.GetMyMutableContextFromRoot(context), speeds)
