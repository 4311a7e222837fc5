"""Flatness there and back: what inverse dynamics asks of the rotors flies the trajectory."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ApplyForces
from airrace.track import load_track
from airrace.trajopt.flatness import attitude_from_force, heading_vectors, inverse_dynamics
from airrace.trajopt.flight_limits import FlightConstraints, FlightLimits
from airrace.trajopt.gate_regions import GateRegions
from airrace.trajopt.min_snap.circuit import plan_circuit
from airrace.trajopt.reference import as_reference
from airrace.trajopt.time_optimal.optimal_lap import plan_optimal_circuit
from airrace.vehicle import GRAVITY, RACERS, load_vehicle
from tests.worlds.cases import first

TRACK = load_track("student-airrace")
MIDPOINTS = np.array([gate.p_WG for gate in TRACK.gates])
HEADINGS = np.array([gate.heading for gate in TRACK.gates])
PYLONS = TRACK.pylons()[:, :2]
STEP, SPAN = 0.0005, 1.0  # s


def lap(kind, vehicle):
    if kind == "optimal":
        return plan_optimal_circuit(
            GateRegions.windows(MIDPOINTS, HEADINGS, 3.0, 2.5),
            FlightConstraints(PYLONS, 2.0, FlightLimits(vehicle, thrust_share=0.9)),
        )
    return plan_circuit(
        MIDPOINTS,
        HEADINGS,
        kind,
        FlightConstraints(
            PYLONS, 2.0, FlightLimits(vehicle, max_speed=20.0, max_acceleration=10.0)
        ),
    )


def pose_and_rates(sample):
    """Returns R_WB, and w and v in the world, of a sample (18,)."""
    force = as_reference(sample).acceleration + [0.0, 0.0, GRAVITY]
    *_, yaw, rate, acceleration = as_reference(sample)
    axes, w, _ = attitude_from_force(
        force,
        as_reference(sample).jerk,
        as_reference(sample).snap,
        heading_vectors(np.cos(yaw), np.sin(yaw), rate, acceleration),
    )
    R = np.column_stack(axes)
    return R, R @ w, as_reference(sample).velocity


@pytest.mark.slow
@pytest.mark.parametrize("drone", first(RACERS))
@pytest.mark.parametrize("kind", first(["optimal", 4, 6]))
def test_thrusts_alone_without_any_feedback_fly_a_lap_for_a_while(kind, drone):
    vehicle, sdf = load_vehicle(drone)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, STEP)
    body = AddMultirotorModel(plant, vehicle, sdf)
    plant.Finalize()
    rotors, forces = AddMultirotor(builder, body, scene_graph, vehicle)
    ApplyForces(builder, plant, [forces])
    builder.ExportInput(rotors.GetInputPort("rotor_speed_command"), "command")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    own, of_rotors = (
        plant.GetMyMutableContextFromRoot(context),
        (rotors.GetMyMutableContextFromRoot(context)),
    )
    trajectory = lap(kind, vehicle)
    begin = 0.3 * trajectory.duration
    times = begin + STEP * np.arange(int(SPAN / STEP))
    # Thrusts are held over a step: take them from its middle.
    thrusts = inverse_dynamics(trajectory.sample(times + STEP / 2), vehicle)[0]
    samples = trajectory.sample(np.append(times, times[-1] + STEP))
    R, w, v = pose_and_rates(samples[:, 0])
    plant.SetFloatingBaseBodyPoseInWorldFrame(
        own, body, RigidTransform(RotationMatrix(R), as_reference(samples[:, 0]).position)
    )
    plant.SetVelocities(own, np.concatenate([w, v]))
    simulator.Initialize()
    for k, thrust in enumerate(thrusts.T):
        speeds = np.sqrt(thrust / vehicle.thrust_coefficients)
        rotors.set_speeds(of_rotors, speeds)
        diagram.GetInputPort("command").FixValue(context, speeds)
        simulator.AdvanceTo((k + 1) * STEP)
    X = plant.EvalBodyPoseInWorld(own, body)
    R, _, v = pose_and_rates(samples[:, -1])
    flown = np.linalg.norm(
        as_reference(samples[:, -1]).position - as_reference(samples[:, 0]).position
    )
    assert flown > 5.0
    np.testing.assert_allclose(
        X.translation(), as_reference(samples[:, -1]).position, atol=2e-3 * flown
    )
    np.testing.assert_allclose(plant.GetVelocities(own)[3:], v, atol=0.01 * np.linalg.norm(v))
    off = np.arccos(np.clip((np.trace(R.T @ X.rotation().matrix()) - 1) / 2, -1, 1))
    assert off < np.deg2rad(1.0)
