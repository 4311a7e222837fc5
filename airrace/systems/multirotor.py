"""A multirotor in a MultibodyPlant."""

import numpy as np
from pydrake.geometry import Role
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import Propeller, PropellerInfo

from airrace.errors import UserError
from airrace.systems.rotor_bank import RotorBank
from airrace.vehicle import Vehicle


def AddMultirotorModel(plant, vehicle: Vehicle, sdf) -> None:
    """Adds the drone's link to a plant that is not yet finalized.

    Its visuals lose the perception role, because the camera sits among them.

    Args:
        plant: a MultibodyPlant registered with a SceneGraph.
        vehicle: what the model must agree with.
        sdf: the model's file; its only link is named ``body``.

    Raises:
        UserError: if the SDF's mass or inertia contradict the vehicle.
    """
    (model,) = Parser(plant).AddModels(str(sdf))
    body = plant.GetBodyByName("body", model)
    M = body.default_spatial_inertia()
    if not (
        np.isclose(M.get_mass(), vehicle.mass)
        and np.allclose(M.CalcRotationalInertia().CopyToFullMatrix3(), np.diag(vehicle.inertia))
        and np.allclose(M.get_com(), 0.0)
    ):
        raise UserError(
            f"The model {sdf} must have the mass and inertia of its vehicle.yaml "
            "about a centre of mass at the origin; make them equal."
        )


def AddMultirotor(builder, plant, scene_graph, vehicle: Vehicle) -> RotorBank:
    """Connects rotors to the drone of a finalized plant.

    Args:
        builder: the DiagramBuilder that owns plant and scene_graph.
        plant: with a link ``body`` from AddMultirotorModel.
        scene_graph: with the drone's geometry.
        vehicle: the rotor table.

    Returns:
        the RotorBank, whose input ``rotor_speed_command`` is left open.
    """
    body = plant.GetBodyByName("body")
    frame_id = plant.GetBodyFrameIdOrThrow(body.index())
    for geometry_id in scene_graph.model_inspector().GetGeometries(frame_id, Role.kPerception):
        scene_graph.RemoveRole(plant.get_source_id(), geometry_id, Role.kPerception)
    rotors = builder.AddNamedSystem(
        "rotor_bank", RotorBank(vehicle=vehicle, period=plant.time_step())
    )
    propellers = builder.AddNamedSystem(
        "propellers",
        Propeller(
            [
                PropellerInfo(body.index(), RigidTransform(r.position), 1.0, r.moment_ratio)
                for r in vehicle.rotors
            ]
        ),
    )
    builder.Connect(rotors.GetOutputPort("thrusts"), propellers.get_command_input_port())
    builder.Connect(plant.get_body_poses_output_port(), propellers.get_body_poses_input_port())
    builder.Connect(
        propellers.get_spatial_forces_output_port(), plant.get_applied_spatial_force_input_port()
    )
    return rotors
