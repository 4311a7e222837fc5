"""The door through which all goes that systems of a scenario's own make."""

from collections.abc import Mapping

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder, OutputPort, PortDataType, System

from airrace.diagrams.wiring import Port, outputs_of
from airrace.scenario import Scenario
from airrace.systems.contract import check_value, finite_vector, name_of
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.types import Detections, ExplorerStatus, PolicyStatus
from airrace.track.gate_map import GateMap

# What ports hold that are no vectors; what other ports give is not looked at.
_KINDS = {
    "detections": Detections,
    "gate_map": GateMap,
    "explorer_status": ExplorerStatus,
    "lap_plan": LapPlan,
    "policy_status": PolicyStatus,
    "estimate_fault": str,
}
# Vectors that are not finite where nothing is known, or nothing has happened.
_NOT_FINITE = {"rotor_losses", "corrections", "estimate_drift", "imu_history", "imu_silence"}

# Nothing but NaN says here that nothing is known yet.
_UNKNOWN_AT_FIRST = {"state_estimate", "filtered_estimate"}


class CheckedPorts(LeafSystem):
    """Passes the outputs of a system on, or ends the race with one sentence.

    .. pydrake_system::

        name: CheckedPorts
        input_ports:
        - those that the outputs have
        output_ports:
        - the outputs of the system, by their names

    A vector must be finite, but where a box of airrace's own would give others, too; a value must
    be of the kind that its port has, and whole; see systems/contract.py.
    """

    def __init__(self, name: str, system: System):
        """Args: name: of the system, in the scenario. system: whose outputs they are."""
        LeafSystem.__init__(self)
        for port in outputs_of(system).values():
            who = f"systems.{name}: {name_of(system)}, output port {port.get_name()},"
            if port.get_data_type() == PortDataType.kVectorValued:
                self._pass_vector(who, port.get_name(), port.size())
            elif port.get_name() in _KINDS:
                self._pass_value(who, port)

    def _pass_vector(self, who, name, size):
        port = self.DeclareVectorInputPort(name, size)

        def calc(context, output):
            vector = port.Eval(context)
            is_known = name not in _UNKNOWN_AT_FIRST or not np.isnan(vector).all()
            if name not in _NOT_FINITE and is_known:
                finite_vector(who, vector, size, f"{size} finite numbers")
            output.set_value(vector)

        self.DeclareVectorOutputPort(name, size, calc, {port.ticket()})

    def _pass_value(self, who, source):
        name, nothing = source.get_name(), source.Allocate().get_value()
        port, kind = self.DeclareAbstractInputPort(name, Value[object]()), _KINDS[name]

        def calc(context, output):
            value = port.Eval(context)
            check_value(who, value, kind)
            output.set_value(value)

        self.DeclareAbstractOutputPort(name, lambda: Value[object](nothing), calc, {port.ticket()})


def checked_outputs(
    builder: DiagramBuilder, systems: Mapping[str, System], scenario: Scenario
) -> dict[Port, OutputPort]:
    """Returns the output ports of systems, by the names that the systems have and their own.

    Those of the scenario's own systems are behind a CheckedPorts, which is added to the builder.
    """
    ports = {}
    for name, system in systems.items():
        outputs = outputs_of(system)
        if name in scenario.systems:
            door = builder.AddNamedSystem(f"checked_{name}", CheckedPorts(name, system))
            checked = outputs_of(door)
            for each in checked:
                builder.Connect(outputs[each], door.GetInputPort(each))
            outputs |= checked
        ports |= {Port(name, each): port for each, port in outputs.items()}
    return ports
