"""A flight without a race: the simulated world, and only what controls the drone."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource
from scipy.spatial.transform import Rotation

from airrace.diagrams.autonomy import make_systems
from airrace.diagrams.checked_ports import checked_outputs
from airrace.diagrams.simulation import MakeMonitor, MakeSimulation
from airrace.diagrams.wiring import connect_by_name, export_outputs, outputs_of
from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.types import ExplorerStatus
from airrace.trajopt.flat_trajectory import flat_outputs
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.state import as_plant_state

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

CONTROL = ("rotor_monitor", "state_filter", "geometric_controller")
OUTPUTS = ("truth.state", "truth.referee_status", "rotor_speeds", "rotor_losses")
_STEP = 0.01  # s, between two samples of a flight


class Flown(NamedTuple):
    """What happened in a flight along a reference, every 0.01 s; see fly_reference()."""

    times: np.ndarray  #: (N,) s
    positions: np.ndarray  #: p_WB, (N, 3) m
    speeds: np.ndarray  #: (N,) m/s
    tilts: np.ndarray  #: angles between the thrust axis and the vertical, (N,) degrees
    turn_rates: np.ndarray  #: about the body's z axis, (N,) rad/s
    errors: np.ndarray  #: distances from the reference, (N,) m
    rotor_speeds: np.ndarray  #: of n rotors, (N, n) rad/s
    losses: np.ndarray  #: when each rotor was found to be lost, (n,) s; inf: never
    ended: str | None  #: why the flight was over before its time, or None


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
    CONTROL, as in the Autonomy; OUTPUTS are its outputs.

    Args:
        scenario: of which track, drone, disturbances, failures, noise, and
            the systems of CONTROL matter.
        reference: time (s) to the vector of trajopt/reference.py, (18,).
    """
    builder = DiagramBuilder()
    simulation = builder.AddSystem(MakeSimulation(scenario))
    named = make_systems(scenario, CONTROL)
    systems = [builder.AddNamedSystem(name, system) for name, system in named.items()]
    source = builder.AddNamedSystem("reference_source", ReferenceSource(reference))
    status = builder.AddSystem(ConstantValueSource(Value[object](ExplorerStatus(done=True))))
    made = checked_outputs(builder, named, scenario)
    sources = {port.name: output for port, output in made.items()}
    sources |= outputs_of(simulation, source)
    sources["explorer_status"] = status.get_output_port()
    told = {name: port for name, port in sources.items() if not name.startswith("truth.")}
    connect_by_name(builder, (simulation, *systems), told)
    export_outputs(builder, sources, OUTPUTS)
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
    q, p = X_WB.rotation().ToQuaternion().wxyz(), X_WB.translation()
    state = np.concatenate([q, p, w_WB, v_WB])
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
    vehicle, _ = load_vehicle(scenario.drone)
    wrench = [vehicle.mass * GRAVITY, 0.0, 0.0, 0.0]
    speeds = np.sqrt(np.linalg.pinv(vehicle.allocation) @ wrench / vehicle.thrust_coefficients)
    rotors = simulation.GetSubsystemByName("rotor_bank")
    rotors.set_speeds(rotors.GetMyMutableContextFromRoot(context), speeds)


def fly_reference(
    scenario: Scenario, reference: Callable[[float], np.ndarray], seconds: float, **start: Any
) -> Flown:
    """Flies along a reference until the time is over, or the referee ends the flight.

    Args:
        scenario, reference: of MakeFlight().
        seconds: how long.
        start: X_WB, w_WB and v_WB of start_in_flight().
    """
    flight = MakeFlight(scenario, reference)
    simulator = Simulator(flight)
    set_bodies = MakeMonitor(flight)
    context = simulator.get_mutable_context()
    start_in_flight(flight, scenario, context, **start)
    simulator.Initialize()
    state, referee, rotors, losses = (flight.GetOutputPort(name) for name in OUTPUTS)
    states, rotor_speeds = [], []
    for k in range(1, round(seconds / _STEP) + 1):
        simulator.AdvanceTo(k * _STEP)
        set_bodies(context)
        states.append(state.Eval(context).copy())
        rotor_speeds.append(rotors.Eval(context).copy())
        if referee.Eval(context).over:
            break
    flown = as_plant_state(np.transpose(states))
    times = _STEP * np.arange(1, len(states) + 1)
    wanted = np.array([reference(time)[:3] for time in times])
    R_WB = Rotation.from_quat(flown.quaternion.T, scalar_first=True)
    z_W = R_WB.apply([0.0, 0.0, 1.0])
    return Flown(
        times=times,
        positions=flown.position.T,
        speeds=np.linalg.norm(flown.velocity, axis=0),
        tilts=np.rad2deg(np.arccos(np.clip(z_W[:, 2], -1.0, 1.0))),
        turn_rates=np.sum(z_W * flown.angular_velocity.T, axis=1),
        errors=np.linalg.norm(flown.position.T - wanted, axis=1),
        rotor_speeds=np.array(rotor_speeds),
        losses=losses.Eval(context).copy(),
        ended=referee.Eval(context).dnf_reason,
    )


def circle_reference(
    radius: float, speed: float, height: float, center: ArrayLike = (0.0, 0.0)
) -> Callable[[float], np.ndarray]:
    """Returns the reference of a level circle, counter-clockwise, with the nose turning along.

    Args:
        radius, height: (m). It begins at ``center + [radius, 0]``.
        speed: (m/s).
        center: [x, y] in the world (m).
    """
    rate = speed / radius

    def reference(time):
        derivatives = np.zeros((5, 4))
        for k in range(5):  # each derivative turns by a quarter
            angle = rate * time + k * np.pi / 2
            derivatives[k, :2] = radius * rate**k * np.array([np.cos(angle), np.sin(angle)])
        derivatives[0, :2] += np.asarray(center, float)
        derivatives[0, 2:] = height, rate * time
        derivatives[1, 3] = rate
        return flat_outputs(derivatives)

    return reference
