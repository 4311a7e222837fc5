"""Carries the explorer's reference on to the present."""

from airrace.common.jit import compiled
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.trajopt.reference import REFERENCE_SIZE, Reference, as_reference, reference_vector

_MOST = 0.3  # s; a drone that hears nothing new for longer is to stop there


class HeldReference(LeafSystem):
    """Follows a reference between the times at which it is told one.

    .. pydrake_system::

        name: HeldReference
        input_ports:
        - exploration_reference
        - values_time
        output_ports:
        - exploration_reference

    The navigator, in a process of its own, says now and then where the drone should be, and how
    that changes: see trajopt/reference.py. The pilot asks at every tick. In between, the Taylor
    series up to the snap tells it: all that differs from the trajectory itself is where one
    segment of that ends, and the next one starts. ``values_time`` is that of the reference (s).
    After 0.3 s the reference stays where it is.
    """

    def __init__(self) -> None:
        """Constructs the system."""
        LeafSystem.__init__(self)
        self._told = self.DeclareVectorInputPort("exploration_reference", REFERENCE_SIZE)
        self._time = self.DeclareVectorInputPort("values_time", 1)
        self.DeclareVectorOutputPort(
            "exploration_reference",
            REFERENCE_SIZE,
            lambda context, output: output.set_value(
                _carried(
                    read_vector(self._told, context),
                    context.get_time() - read_vector(self._time, context)[0],
                )
            ),
        )


@compiled
def _carried(told, dt):
    """Returns a reference, (18,), a time (s) after another one."""
    p, v, a, j, s, yaw, yaw_rate, yaw_acceleration = as_reference(told)
    t = min(max(dt, 0.0), _MOST)
    p = p + t * (v + t / 2 * (a + t / 3 * (j + t / 4 * s)))
    yaw = yaw + t * (yaw_rate + t / 2 * yaw_acceleration)
    if dt > _MOST:
        return reference_vector(Reference(p, 0.0, 0.0, 0.0, 0.0, yaw, 0.0, 0.0))
    v = v + t * (a + t / 2 * (j + t / 3 * s))
    a, j, yaw_rate = a + t * (j + t / 2 * s), j + t * s, yaw_rate + t * yaw_acceleration
    return reference_vector(Reference(p, v, a, j, s, yaw, yaw_rate, yaw_acceleration))
