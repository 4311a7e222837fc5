"""What the air does to a multirotor's body."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import LeafSystem

from airrace.vehicle import Vehicle


class Drag(LeafSystem):
    """Drag of the rotors and of the airframe.

    .. pydrake_system::

        name: Drag
        input_ports:
        - state
        - wind
        output_ports:
        - spatial_forces

    ``state`` is the plant's floating-body state (13): quaternion of R_WB
    (w, x, y, z), p_WB, w_WB, v_WB; ``wind`` (3) the air's velocity in the
    world (m/s). ``spatial_forces`` is a list of one
    ExternallyAppliedSpatialForce, for the plant: with v the velocity through
    the air and w the angular velocity, both in B, the force is
    -(linear + quadratic |v|) v at the centre of mass and the moment
    -angular w. The part that is linear in v is the rotors' (Faessler, Franchi
    and Scaramuzza, "Differential flatness of quadrotor dynamics subject to
    rotor drag", 2018).
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
            [share * c for c in each] for each in (drag.linear, drag.quadratic, drag.angular)
        ]
        self._body_index = body_index
        self._state = self.DeclareVectorInputPort("state", 13)
        self._wind = self.DeclareVectorInputPort("wind", 3)
        self.DeclareAbstractOutputPort(
            "spatial_forces", Value[list[ExternallyAppliedSpatialForce]], self._CalcForces
        )

    def _CalcForces(self, context, output):
        # Plain numbers: every step of the plant asks, and arrays this small
        # cost more than they spare.
        qw, qx, qy, qz, _, _, _, wx, wy, wz, vx, vy, vz = self._state.Eval(context).tolist()
        ax, ay, az = self._wind.Eval(context).tolist()
        vx, vy, vz = vx - ax, vy - ay, vz - az
        s = 2.0 / (qw * qw + qx * qx + qy * qy + qz * qz)
        # The body axes in the world, the columns of R_WB.
        axes = (
            (1.0 - s * (qy * qy + qz * qz), s * (qx * qy + qw * qz), s * (qx * qz - qw * qy)),
            (s * (qx * qy - qw * qz), 1.0 - s * (qx * qx + qz * qz), s * (qy * qz + qw * qx)),
            (s * (qx * qz + qw * qy), s * (qy * qz - qw * qx), 1.0 - s * (qx * qx + qy * qy)),
        )
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        fx = fy = fz = tx = ty = tz = 0.0
        for (x, y, z), linear, quadratic, angular in zip(axes, *self._coefficients):
            f = (linear + quadratic * speed) * (x * vx + y * vy + z * vz)
            t = angular * (x * wx + y * wy + z * wz)
            fx, fy, fz = fx - f * x, fy - f * y, fz - f * z
            tx, ty, tz = tx - t * x, ty - t * y, tz - t * z
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body_index
        force.p_BoBq_B = np.zeros(3)
        force.F_Bq_W = SpatialForce(np.array([tx, ty, tz, fx, fy, fz]))
        output.set_value([force])
