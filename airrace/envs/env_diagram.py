"""The diagram that an environment steps: the Simulation, and what is between it and a policy."""

from typing import TYPE_CHECKING

from pydrake.common.value import Value
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from airrace.diagrams.autonomy import make_systems
from airrace.diagrams.checked_ports import checked_outputs
from airrace.diagrams.simulation import MakeSimulation
from airrace.diagrams.wiring import connect_by_name, export_inputs, export_outputs, outputs_of
from airrace.scenario import Scenario
from airrace.systems.control.rate_controller import RateController
from airrace.systems.planning.held_reference import HeldReference
from airrace.systems.sensing.state_estimate import TrueEstimate
from airrace.systems.types import ExplorerStatus

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

# What a policy may see of the simulation, and of the systems of the autonomy.
_OUTPUTS = (
    "truth.state",
    "truth.referee_status",
    "truth.gate_shifts",
    "camera_image",
    "filtered_estimate",
    "gate_map",
)
_ESTIMATION = ("aruco_detector", "gate_mapper", "state_filter", "gate_slam", "strapdown_integrator")
_GEOMETRIC = ("rotor_monitor", "geometric_controller")
# What carries the position of an action of the kind `reference` on between two actions.
REFERENCE_PORTS = ("exploration_reference", "values_time")


def MakeEnvDiagram(
    scenario: Scenario, *, action: str, observation: str, meshcat: "Meshcat | None" = None
) -> Diagram:
    """Builds what an environment steps: a subsystem ``simulation``, and what controls.

    Its inputs follow from the kind of the actions: ``rate_command`` of ``ctbr``, see
    RateController; ``rotor_speed_command`` of ``rotors``; REFERENCE_PORTS of ``reference``. With
    ``ctbr``, the rate controller knows the truth, but for the observation ``estimate``. Its
    outputs are those of the Simulation's and the autonomy's that there are of ``truth.state``,
    ``truth.referee_status``, ``truth.gate_shifts``, ``camera_image``, ``filtered_estimate`` and
    ``gate_map``.

    Args: action, observation: kinds, see EnvOptions. meshcat: to show the world in, or None.

    Raises:
        UserError: if something the scenario names cannot be had.
    """
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario, meshcat))
    names = [*_ESTIMATION] if observation == "estimate" else []
    if action == "reference":
        names += [*_GEOMETRIC, *([] if names else ["state_filter"])]
    systems = make_systems(scenario, names)
    if action == "ctbr":
        if observation != "estimate":
            systems["true_estimate"] = TrueEstimate()
        systems["rate_controller"] = RateController.from_scenario(scenario)
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    status = builder.AddSystem(ConstantValueSource(Value[object](ExplorerStatus(done=True))))
    made = checked_outputs(builder, systems, scenario)
    outputs = {port.name: output for port, output in made.items()}
    sources = outputs_of(simulation) | outputs
    sources["explorer_status"] = status.get_output_port()
    if action == "reference":
        reference = builder.AddNamedSystem("held_reference", HeldReference())
        for name in REFERENCE_PORTS:
            builder.ExportInput(reference.GetInputPort(name), name)
        sources["reference"] = reference.GetOutputPort("exploration_reference")
    export_inputs(builder, connect_by_name(builder, [simulation, *systems.values()], sources))
    export_outputs(builder, outputs | outputs_of(simulation), _OUTPUTS)
    diagram = builder.Build()
    diagram.set_name("environment")
    return diagram
