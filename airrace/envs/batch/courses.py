"""The tracks that a batch of drones flies on, as arrays for machine code."""

from typing import NamedTuple

import numpy as np

from airrace.envs.reward import NEVER, make_course
from airrace.track import Track, start_pose
from airrace.track.gate_opening import OPENING_SIZE


class Courses(NamedTuple):
    """T tracks of up to G gates."""

    counts: np.ndarray  #: of gates, (T,)
    goals: np.ndarray  #: how many to pass until an episode is finished, (T,)
    gates: np.ndarray  #: numbers of their openings, see Opening; NaN beyond the last, (T, G, 15)
    take_off_height: np.ndarray  #: above which a drone flies (m), (T,)
    arena_min: np.ndarray  #: x and y of the arena, (T, 2) m
    arena_max: np.ndarray  #: its x, y and z, (T, 3) m
    pads: np.ndarray  #: quaternion of R_WB and p_WB of a drone that stands on its pad, (T, 7)
    hover: np.ndarray  #: p_WB (m) and heading (rad) of the first hover over the start, (T, 4)


def make_courses(
    tracks: list[Track],
    *,
    laps: int | None,
    arena_margin: float,
    radius: float,
    standing_height: float,
    clearance: float = 0.0,
) -> Courses:
    """Returns tracks as arrays.

    Args:
        laps: from gate 1 to gate 1, after which a race is finished; None: it goes on.
        arena_margin: how far the arena reaches beyond the outermost pylons and upwards (m).
        radius: of the drone, see Vehicle (m).
        standing_height: of the body's origin when the drone stands (m).
        clearance: how near to the ground is a collision, once the drone was higher (m).
    """
    courses, pads, hover = [], [], []
    for track in tracks:
        start = track.start
        X_WB = start_pose(start, radius, standing_height)
        pads.append([*X_WB.rotation().ToQuaternion().wxyz(), *X_WB.translation()])
        hover.append([*start.position[:2], track.hover_height, np.deg2rad(start.heading_deg)])
        courses.append(
            make_course(
                track,
                goal=NEVER if laps is None else laps * len(track.gates) + 1,
                arena_margin=arena_margin,
                standing_height=float(X_WB.translation()[2]) + clearance,
            )
        )
    counts = np.array([len(course.gates) for course in courses])
    gates = np.full((len(tracks), counts.max(), OPENING_SIZE), np.nan)
    for rows, course in zip(gates, courses):
        rows[: len(course.gates)] = course.gates
    return Courses(
        counts=counts,
        goals=np.array([course.goal for course in courses]),
        gates=gates,
        take_off_height=np.array([course.take_off_height for course in courses]),
        arena_min=np.array([course.arena_min for course in courses]),
        arena_max=np.array([course.arena_max for course in courses]),
        pads=np.array(pads),
        hover=np.array(hover),
    )
