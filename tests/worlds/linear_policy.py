"""A policy that was not learned: one linear layer, which flies slowly from gate to gate."""

import numpy as np

from airrace.systems.policy.command_scale import ctbr_scale
from airrace.systems.policy.gates_observation import observation_size
from airrace.systems.policy.policy_network import ACTIONS, PolicyNetwork
from airrace.vehicle import GRAVITY, Vehicle

_GATES = 2
V, R, W, CORNERS = 0, 3, 12, 15  # where the parts of the observation begin
_PULLS = (0.3, 0.06)  # 1/s, of the wanted velocity on the ways to the next two gates
_TILT = 0.06  # rad per m/s that is missing
_LEVEL = 5.0  # 1/s, of the rates on errors of the tilt
_LIFT = 4.0  # 1/s, of the thrust per mass on errors of the vertical speed
_YAW = 0.05  # rad/s per metre that the gate is to the left


def linear_network(vehicle: Vehicle, hovers: bool = False, **changes) -> PolicyNetwork:
    """Returns the network of a PD controller about a hover, within any bounds.

    Args:
        vehicle: that it flies.
        hovers: whether it stays where it is and looks at no gate.
        changes: attributes of the network that are to be others.
    """
    m = observation_size(_GATES, ACTIONS)
    scale = ctbr_scale(vehicle)
    command = np.zeros((ACTIONS, m))  # of thrust and rates, without their constant parts
    command[0, V + 2] = -vehicle.mass * _LIFT
    command[1, V + 1], command[1, R + 7] = _LEVEL * _TILT, -_LEVEL
    command[2, V], command[2, R + 6] = -_LEVEL * _TILT, _LEVEL
    for gate, pull in enumerate(() if hovers else _PULLS):
        x, y, z = (range(CORNERS + 12 * gate + k, CORNERS + 12 * gate + 12, 3) for k in range(3))
        command[0, z] = vehicle.mass * _LIFT * pull / 4
        command[1, y] = -_LEVEL * _TILT * pull / 4
        command[2, x] = _LEVEL * _TILT * pull / 4
        if gate == 0:
            command[3, y] = _YAW / 4
    hover = np.array([vehicle.mass * GRAVITY, 0.0, 0.0, 0.0])
    network = PolicyNetwork(
        weights=(command / scale.half_range[:, None],),
        biases=((hover - scale.center) / scale.half_range,),
        mean=np.zeros(m),
        scale=np.ones(m),
        low=np.full(m, -np.inf),
        high=np.full(m, np.inf),
        gates=_GATES,
        drone=vehicle.name,
        made_by="tests/worlds/linear_policy.py",
    )
    return network._replace(**changes)
