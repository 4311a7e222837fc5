"""A drone in empty space, in a hover, for controllers that are tested in the plant."""

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.systems.plant.multirotor import AddMultirotor, AddMultirotorModel, ApplyForces
from airrace.systems.sensing.state_estimate import TrueEstimate
from airrace.vehicle import GRAVITY, Vehicle, load_vehicle

RATE, DT = 500.0, 0.001


def hover(vehicle: Vehicle) -> tuple[float, np.ndarray]:
    """Returns the weight (N), and the rotor speeds that carry it (rad/s)."""
    weight = vehicle.mass * GRAVITY
    thrusts = np.linalg.pinv(vehicle.allocation)[:, 0] * weight
    return weight, np.sqrt(thrusts / vehicle.thrust_coefficients)


def add_hovering_plant(builder: DiagramBuilder, drone: str):
    """Adds a drone's plant, its rotors and what knows its state; exports the plant's ``state``.

    Returns:
        the vehicle, the rotors and a TrueEstimate.
    """
    vehicle, sdf = load_vehicle(drone)
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, DT)
    plant.SetUseSampledOutputPorts(False)
    body = AddMultirotorModel(plant, vehicle, sdf)
    plant.Finalize()
    rotors, forces = AddMultirotor(builder, body, scene_graph, vehicle, rate=RATE)
    ApplyForces(builder, plant, [forces])
    estimate = builder.AddSystem(TrueEstimate())
    builder.Connect(plant.get_state_output_port(), estimate.get_input_port())
    builder.ExportOutput(plant.get_state_output_port(), "state")
    return vehicle, rotors, estimate
