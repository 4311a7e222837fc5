"""What the air does to a multirotor's body."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex

from airrace.common.jit import compiled
from airrace.math.quaternion import rotation_matrix
from airrace.math.vec3 import dot, rotate
from airrace.systems.leaf_system import LeafSystem
from airrace.vehicle import Vehicle
from airrace.vehicle.state import as_plant_state


class Drag(LeafSystem):
    """Drag of the rotors and of the airframe.

    .. pydrake_system::

        name: Drag
        input_ports:
        - state
        - wind
        output_ports:
        - spatial_forces

    ``state`` is the plant's floating-base state (13), see vehicle.State; ``wind`` (3)
    the air's velocity in the world (m/s). ``spatial_forces`` is a list of one
    ExternallyAppliedSpatialForce, for the plant: with v the velocity through the air
    and w the angular velocity, both in B, the force is -(linear + quadratic |v|) v at
    the centre of mass and the moment -angular w. The part that is linear in v is the
    rotors' (Faessler, Franchi and Scaramuzza, "Differential flatness of quadrotor
    dynamics subject to rotor drag", 2018).
    """

    def __init__(self, *, vehicle: Vehicle, share: float, body_index: BodyIndex):
        """Constructs the drag.

        Args:
            vehicle: whose coefficients, with its centre of mass at the
                body's origin.
            share: of the coefficients that acts; 1 is all.
            body_index: of the body in the plant.
        """
        LeafSystem.__init__(self)
        drag = vehicle.drag
        self._coefficients = [
            share * np.array(c) for c in (drag.linear, drag.quadratic, drag.angular)
        ]
        self._body_index = body_index
        self._state = self.DeclareVectorInputPort("state", 13)
        self._wind = self.DeclareVectorInputPort("wind", 3)
        self.DeclareAbstractOutputPort(
            "spatial_forces", Value[list[ExternallyAppliedSpatialForce]], self._calc_forces
        )

    def _calc_forces(self, context, output):
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body_index
        force.p_BoBq_B = np.zeros(3)
        force.F_Bq_W = SpatialForce(
            _drag(self._state.Eval(context), self._wind.Eval(context), *self._coefficients)
        )
        output.set_value([force])


@compiled
def _drag(state, wind, linear, quadratic, angular):
    """Returns moment (N m) and force (N) in the world, (6,); see Drag."""
    state = as_plant_state(state)
    R_WB = rotation_matrix(state.quaternion)
    v = state.velocity - wind
    w_B, v_B = rotate(R_WB.T, state.angular_velocity), rotate(R_WB.T, v)
    force = -(linear + quadratic * math.sqrt(dot(v, v))) * v_B
    return np.concatenate((rotate(R_WB, -angular * w_B), rotate(R_WB, force)))
