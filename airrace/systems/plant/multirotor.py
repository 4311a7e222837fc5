"""A multirotor in a MultibodyPlant."""

import contextlib
import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from xml.dom import expatbuilder
from xml.parsers.expat import ExpatError

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
    Propeller,
    PropellerInfo,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from airrace.common.errors import UserError
from airrace.systems.plant.rotor_bank import RotorBank
from airrace.vehicle import Vehicle


@contextlib.contextmanager
def _warnings_if_accepted():
    """Drops Drake's warnings about a model if the block refuses it: its error says enough."""
    drake, held = logging.getLogger("drake"), []

    def hold(record):
        held.append(record)
        return False

    drake.addFilter(hold)
    try:
        yield
    finally:
        drake.removeFilter(hold)
    for record in held:
        drake.handle(record)


@_warnings_if_accepted()
def AddMultirotorModel(
    plant: MultibodyPlant, vehicle: Vehicle, sdf: Path, truth: Vehicle | None = None
) -> RigidBody:
    """Adds a drone's link to a plant that is not yet finalized, and returns it.

    Args:
        plant: a MultibodyPlant registered with a SceneGraph.
        vehicle: what the model must agree with.
        sdf: the model's file, with one link, named ``body``, and no joints.
        truth: whose mass and inertia the link gets; the vehicle's by default.

    Raises:
        UserError: if Drake cannot read the SDF, or it is not such a model, or
            its mass or inertia contradict the vehicle.
    """
    bodies, joints = plant.num_bodies(), plant.num_joints()
    parser = Parser(plant)
    parser.SetAutoRenaming(True)  # of a second drone of this model
    truth = truth or vehicle
    mass_factor = truth.mass / vehicle.mass
    inertia_factor = truth.inertia[0] / vehicle.inertia[0]
    try:
        if mass_factor == inertia_factor == 1.0:
            instances = parser.AddModels(str(sdf))
        else:
            text = _scaled_model(sdf, mass_factor, inertia_factor)
            instances = parser.AddModels(file_contents=text, file_type="sdf")
    except (RuntimeError, ExpatError) as e:
        raise UserError(f"The model {sdf} cannot be used: {' '.join(str(e).split())}") from None
    added = (plant.num_bodies() - bodies, plant.num_joints() - joints)
    if added != (1, 0) or not plant.HasBodyNamed("body", instances[0]):
        raise UserError(
            f"The model {sdf} cannot be used: it must be one link, named 'body', without joints."
        )
    body = plant.GetBodyByName("body", instances[0])
    M = body.default_spatial_inertia()
    # What is scaled agrees with the truth if the file agrees with the vehicle.
    if not np.isclose(M.get_mass(), truth.mass):
        mass = M.get_mass() / mass_factor
        raise UserError(
            f"The model {sdf} has a mass of {mass:g} kg, and its vehicle.yaml {vehicle.mass:g} kg; "
            "make them equal."
        )
    if not (
        np.allclose(M.CalcRotationalInertia().CopyToFullMatrix3(), np.diag(truth.inertia))
        and np.allclose(M.get_com(), 0.0)
    ):
        raise UserError(
            f"The model {sdf} must have the moments of inertia of its vehicle.yaml, "
            f"{', '.join(f'{moment:g}' for moment in vehicle.inertia)} kg m^2, about a centre of "
            "mass at the origin; make them equal."
        )
    return body


def _scaled_model(sdf: Path, mass_factor: float, inertia_factor: float) -> str:
    """Returns the text of a model with another mass and inertia.

    Drake has no way to set those of a body before the simulation starts.
    """
    # Drake's own tags have a prefix that need not be declared.
    document = expatbuilder.parse(str(sdf), namespaces=False)
    factors = {"mass": mass_factor}
    factors |= dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), inertia_factor)
    for name, factor in factors.items():
        for element in document.getElementsByTagName(name):
            element.firstChild.data = repr(factor * float(element.firstChild.data))  # type: ignore[union-attr]
    # A text has no folder that the files it names could be relative to.
    for name in ("uri", "drake:diffuse_map"):
        for element in document.getElementsByTagName(name):
            uri = element.firstChild.data.strip()  # type: ignore[union-attr]
            if "://" not in uri:
                element.firstChild.data = f"file://{sdf.parent.resolve() / uri}"  # type: ignore[union-attr]
    return document.toxml()


def ground_clearance(body: RigidBody, scene_graph: SceneGraph) -> float:
    """Returns how high the origin of a drone is when it stands (m).

    That is from the boxes around its collision geometries: a drone that is
    placed by it may be a little above the ground, but never in it.

    Args: body: of AddMultirotorModel(). scene_graph: with its geometry.

    Raises:
        UserError: if the drone has nothing to stand on.
    """
    inspector = scene_graph.model_inspector()
    heights = []
    for geometry_id in body.GetParentPlant().GetCollisionGeometriesForBody(body):
        box = inspector.GetObbInGeometryFrame(geometry_id)
        if box is not None:  # a plane has no end
            X_BO = inspector.GetPoseInFrame(geometry_id) @ box.pose()
            reach = np.abs(X_BO.rotation().matrix()[2]) @ box.half_width()
            heights.append(X_BO.translation()[2] - reach)
    if not heights:
        raise UserError(
            "The drone has nothing to stand on: its SDF file needs collision geometries, "
            "such as four spheres."
        )
    return -min(heights)


def AddMultirotor(
    builder: DiagramBuilder,
    body: RigidBody,
    scene_graph: SceneGraph,
    vehicle: Vehicle,
    *,
    drawn: "Callable[[int], Vehicle] | None" = None,
    rate: float | None = None,
    failures: Iterable[tuple[int, float]] = (),
    visible: bool = True,
    suffix: str = "",
) -> tuple[RotorBank, OutputPort]:
    """Adds the rotors of a drone whose plant is finalized.

    Its visuals lose the perception role, because the camera sits among them.

    Args:
        builder: the DiagramBuilder that owns the plant and scene_graph.
        body: of AddMultirotorModel().
        scene_graph: with its geometry.
        vehicle: the rotor table.
        drawn: see RotorBank.
        rate: of the motor controllers (Hz); by default, as often as the plant steps.
        failures: of rotors, see RotorBank.
        visible: whether the drone is drawn, in Meshcat: its visuals cost time at every
            step of the plant.
        suffix: of the names of its subsystems.

    Returns:
        the RotorBank, whose input ``rotor_speed_command`` is left open, and the port of the forces
        of the rotors, for ApplyForces().
    """
    plant = body.GetParentPlant()
    frame_id = plant.GetBodyFrameIdOrThrow(body.index())
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for geometry_id in inspector.GetGeometries(frame_id):
        if visible:
            scene_graph.RemoveRole(source, geometry_id, Role.kPerception)
        elif inspector.GetProximityProperties(geometry_id) is None:
            scene_graph.RemoveGeometry(source, geometry_id)
    period = 1.0 / rate if rate else plant.time_step()
    rotors = RotorBank(vehicle=vehicle, period=period, failures=failures, drawn=drawn)
    builder.AddNamedSystem("rotor_bank" + suffix, rotors)
    thrusts, forces = AddPropellers(builder, body, vehicle, suffix)
    builder.Connect(rotors.GetOutputPort("thrusts"), thrusts)
    return rotors, forces


def AddPropellers(
    builder: "DiagramBuilder", body: RigidBody, vehicle: Vehicle, suffix: str = ""
) -> "tuple[InputPort, OutputPort]":
    """Adds what turns the thrusts of a drone's rotors into forces on it.

    Args: as of AddMultirotor().

    Returns:
        the ports of the thrusts (N), one a rotor, and of the forces, for ApplyForces().
    """
    plant = body.GetParentPlant()
    propellers = Propeller(
        [
            PropellerInfo(body.index(), RigidTransform(r.position), 1.0, r.moment_ratio)
            for r in vehicle.rotors
        ]
    )
    builder.AddNamedSystem("propellers" + suffix, propellers)
    builder.Connect(plant.get_body_poses_output_port(), propellers.get_body_poses_input_port())
    return propellers.get_command_input_port(), propellers.get_spatial_forces_output_port()


def ApplyForces(
    builder: DiagramBuilder, plant: MultibodyPlant, forces: Sequence[OutputPort]
) -> None:
    """Connects all that acts on the drones of a plant with it. Args: forces: at least one port."""
    applied = forces[0]
    if len(forces) > 1:
        total = ExternallyAppliedSpatialForceMultiplexer(num_inputs=len(forces))
        builder.AddNamedSystem("forces", total)
        for i, port in enumerate(forces):
            builder.Connect(port, total.get_input_port(i))
        applied = total.get_output_port()
    builder.Connect(applied, plant.get_applied_spatial_force_input_port())
