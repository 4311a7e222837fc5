"""The Autonomy diagram: from pixels to rotor speeds, without the truth.

It has two halves. The pilot controls, at hundreds of hertz; the navigator sees, maps, explores and
plans, which takes as long as it takes. In SITL and in lockstep both are in one diagram. In real
time each has a diagram, and a process, of its own, so that the drone is controlled while it thinks.
"""

from collections.abc import Collection, Mapping

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from airrace.common.errors import UserError
from airrace.diagrams.checked_ports import checked_outputs
from airrace.diagrams.own_systems import make_system
from airrace.diagrams.variants import Variant, variant_of
from airrace.diagrams.wiring import Port, connect_by_name, export_inputs, export_outputs, outputs_of
from airrace.scenario import Scenario
from airrace.scenario.camera_config import NO_CAMERA
from airrace.systems.perception.rectifier import Rectifier


def MakeAutonomy(scenario: Scenario) -> Diagram:
    """Builds the autonomy of a scenario.

    The ports carry the names of what they carry, and ports of the same name are connected; see
    Variant for what there is. All outputs of the variant are outputs of the diagram. If the
    camera's lens distorts, a Rectifier stands between its images and every system.

    Args:
        scenario: the race; of its track, only the hover height is used.

    Raises:
        UserError: if a system of the scenario cannot be had or does not fit.
    """
    variant = variant_of(scenario)
    return _make_part("autonomy", scenario, variant, list(variant.systems))


def MakePilot(scenario: Scenario, given: Collection[str] = ()) -> Diagram:
    """Builds the half of the autonomy that controls: see MakeAutonomy() and Variant.pilot.

    What its systems get from the navigator's are inputs of the diagram.

    Args:
        scenario: the race.
        given: which of its own outputs its systems get from outside instead.
    """
    variant = variant_of(scenario)
    names = [name for name in variant.systems if name in variant.pilot]
    return _make_part("pilot", scenario, variant, names, given)


def MakeNavigator(scenario: Scenario) -> Diagram:
    """Builds the other half of the autonomy: what sees, maps, explores and plans.

    What its systems get from the pilot's are inputs of the diagram. Args: scenario: the race.
    """
    variant = variant_of(scenario)
    names = [name for name in variant.systems if name not in variant.pilot]
    return _make_part("navigator", scenario, variant, names)


def make_systems(scenario: Scenario, names: Collection[str]) -> dict[str, System]:
    """Makes those systems of a scenario's autonomy that have one of the names."""
    systems = variant_of(scenario).systems
    return {name: make_system(name, systems[name], scenario) for name in names if name in systems}


def _make_part(
    part: str, scenario: Scenario, variant: Variant, names: list[str], given: Collection[str] = ()
) -> Diagram:
    """Builds the diagram of some of the systems; the outputs of the others are inputs of it."""
    for name in scenario.systems:
        if name not in variant.systems:
            raise UserError(
                f"systems.{name} is not a system of the autonomy; there are: "
                f"{', '.join(variant.systems)}."
            )
    builder = DiagramBuilder()
    systems = make_systems(scenario, names)
    for name, system in systems.items():
        builder.AddNamedSystem(name, system)
    try:
        ports = checked_outputs(builder, systems, scenario)
        made = {
            name: _output(ports, port)
            for name, port in variant.outputs.items()
            if port.system in systems and (port in ports or name not in variant.optional)
        }
        export_outputs(builder, made, made)
        sources = {name: port for name, port in made.items() if name not in given}
        sinks = list(systems.values())
        bends = scenario.camera.renderer != NO_CAMERA and any(scenario.camera.resolved().distortion)
        if bends:
            sources |= _rectified(builder, sinks)
        inputs = connect_by_name(builder, sinks, sources, variant.aliases)
        outside = {*variant.inputs, *given, *(variant.outputs.keys() - made.keys())}
        for name, ports in inputs.items():
            if name not in outside | variant.optional:
                raise UserError(
                    f"The system {ports[0].get_system().get_name()} has an input port "
                    f"'{ports[0].get_name()}', which nothing provides; there are: "
                    f"{', '.join([*variant.inputs, *variant.outputs])}."
                )
        export_inputs(builder, {n: ports for n, ports in inputs.items() if n in outside})
        diagram = builder.Build()
    except RuntimeError as e:  # Drake's, on types, sizes and algebraic loops
        raise UserError(f"The systems do not fit together: {' '.join(str(e).split())}") from None
    diagram.set_name(part)
    return diagram


def _output(ports: Mapping[Port, OutputPort], port: Port) -> OutputPort:
    if port not in ports:
        there = ", ".join(name for system, name in ports if system == port.system) or "none"
        raise UserError(
            f"The system {port.system} must have an output port '{port.name}'; it has: {there}."
        )
    return ports[port]


def _rectified(builder: DiagramBuilder, sinks: list[System]) -> dict[str, OutputPort]:
    """Adds a Rectifier if a system takes pictures; returns its outputs."""
    rectifier = Rectifier()
    outputs = {
        name: port
        for name, port in outputs_of(rectifier).items()
        if any(sink.HasInputPort(name) for sink in sinks)
    }
    if outputs:
        builder.AddNamedSystem("rectifier", rectifier)
        for name in sorted({*outputs, "camera_info"}):
            builder.ExportInput(rectifier.GetInputPort(name), name)
    return outputs
