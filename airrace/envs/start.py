"""Where an episode begins."""

from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.math.random import make_generator
from airrace.track import Track

STARTS = ("pad", "hover", "random")
# What is drawn for a start in flight, uniformly from -x to x but for the distance.
DISTANCE = (3.0, 7.0)  # m, in front of the gate
SIDE, HEIGHT = 1.5, 1.5  # m, off its midpoint
YAW, TILT = 0.3, 0.1  # rad, off its heading; roll and pitch
SPEED, RATE = 1.0, 0.3  # m/s and rad/s, of each component


class FlyingStart(NamedTuple):
    """A drone in front of a gate, hovering, but for a little."""

    gate: int  #: index of the gate, from 0
    X_WB: RigidTransform  #: pose
    w_WB: np.ndarray  #: (rad/s), (3,)
    v_WB: np.ndarray  #: (m/s), (3,)


def draw_start(track: Track, seed: int) -> FlyingStart:
    """Returns where an episode with the start ``random`` begins.

    It is near enough to the gate that no other one's pylons are near.

    Args: track: with the true gates. seed: of the episode.
    """
    rng = make_generator(seed, "episode start")
    index = int(rng.integers(len(track.gates)))
    gate, distance = track.gates[index], rng.uniform(*DISTANCE)
    side, height, yaw = rng.uniform(-1.0, 1.0, 3) * (SIDE, HEIGHT, YAW)
    roll, pitch = rng.uniform(-TILT, TILT, 2)
    position = gate.p_WG - distance * gate.forward + side * gate.rightward + [0.0, 0.0, height]
    return FlyingStart(
        gate=index,
        X_WB=RigidTransform(RollPitchYaw(roll, pitch, gate.heading + yaw), position),
        w_WB=rng.uniform(-RATE, RATE, 3),
        v_WB=rng.uniform(-SPEED, SPEED, 3),
    )


def hover_start(track: Track) -> FlyingStart:
    """Returns the first hover of a race, over the start and at rest, as the start ``hover``."""
    start = track.start
    position = [*start.position[:2], track.hover_height]
    heading = np.deg2rad(start.heading_deg)
    X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, heading), position)
    return FlyingStart(0, X_WB, np.zeros(3), np.zeros(3))
