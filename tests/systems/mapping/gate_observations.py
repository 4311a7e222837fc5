"""Observations of the boards of a gate, with errors of known size."""

import numpy as np

from airrace.common.immutable import read_only
from airrace.systems.mapping.observation import Observation
from airrace.track import Gate

SIGMA = 0.05  # m


def make_gate(x=20.0, y=5.0, heading_deg=0.0, spacing=10.0) -> Gate:
    """Returns a gate with its midpoint at x, y."""
    gate = Gate([0.0, 0.0], heading_deg, spacing)
    gate.left_pylon = (np.array([x, y]) - spacing / 2 * gate.rightward[:2]).tolist()
    return gate


def see(
    gate: Gate, id: int, time: float, rng, sigma=SIGMA, error=(0.0, 0.0, 0.0), p_WC=None
) -> Observation:
    """Returns an observation of a board of gate number id // 4, by default from where it is seen."""
    board = gate.boards(id // 4)[id % 4]
    normal = board.X_WM.rotation().col(2)
    p_WM = board.X_WM.translation()
    turn = 0.02 * rng.standard_normal()
    c, s = np.cos(turn), np.sin(turn)
    return Observation(
        id=id,
        time=time,
        p_WC=read_only(p_WM + 10.0 * normal if p_WC is None else p_WC),
        p_WM=read_only(p_WM + sigma * rng.standard_normal(3) + error),
        covariance=read_only(sigma**2 * np.eye(3)),
        normal=read_only(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ normal),
        heading_variance=0.05**2,
    )
