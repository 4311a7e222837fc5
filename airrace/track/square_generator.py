"""Random courses of square gates that obey the rules: winding, with climbs and descents."""

import collections

import numpy as np

from airrace.common.errors import UserError
from airrace.math.angles import wrap_angle
from airrace.math.random import make_generator
from airrace.track.rules import RuleError
from airrace.track.square_gate import SquareGate
from airrace.track.square_rules import (
    CLIMB,
    DESCENT,
    GATE_COUNTS,
    HEIGHTS,
    LEGS,
    MOST_GATES,
    PAD_TILT_DEG,
    PITCH,
    START_DISTANCE,
    START_TURN,
    TURN,
    check_legs_apart,
    check_square_rules,
)
from airrace.track.square_track import HALL, SquareTrack
from airrace.track.start import Start

_MEAN_LENGTH = 200.0  # m, of a course of GATE_COUNTS
_SPREAD = 0.15  # of a leg's length
_COURSES, _LEGS = 200, 30  # tried before a seed is refused, and for each leg of a course
_HIGH = 4.5  # m: from there it goes down, as climbs may be steeper than descents
_DRAWN_TURN = 0.8 * TURN  # so that a gate between two legs faces both


def generate_square_track(seed: int, gates: int | None = None) -> SquareTrack:
    """Returns a random course that obeys all of square_rules.py.

    Gate after gate is drawn; what comes near the way so far is drawn again. The same arguments
    give the same course.

    Args:
        seed: at least 0.
        gates: 2 to 20; None to draw 17 to 20 from the seed.

    Raises:
        UserError: for arguments that no course fits, or if the seed has none.
    """
    if seed < 0:
        raise UserError(f"A seed cannot be negative, as {seed} is; give 0 or more.")
    if gates is not None and not 2 <= gates <= MOST_GATES:
        raise UserError(f"There is no course of {gates} square gates; give 2 to {MOST_GATES}.")
    drawn = int(make_generator(seed, "square track").choice(GATE_COUNTS))
    gates = gates or drawn
    rng = make_generator(seed, f"square track {gates}")
    reasons = collections.Counter()
    for _ in range(_COURSES):
        try:
            track = _make_track(_draw_way(rng, gates), rng, f"square-{seed}-{gates}")
            track.check()
            check_square_rules(track)
            return track
        except RuleError as e:
            reasons[e.rule] += 1
    rule, count = reasons.most_common(1)[0]
    raise UserError(
        f"Seed {seed} gives no course of {gates} square gates: of {_COURSES}, {count} broke the "
        f"rule on {rule}; take another seed."
    )


def _draw_way(rng: np.random.Generator, n: int) -> np.ndarray:
    """Returns the pad and n gates, (n + 1, 3) m.

    Raises:
        RuleError: if the course runs into itself.
    """
    count = n if n in GATE_COUNTS else GATE_COUNTS[0]
    mean = (_MEAN_LENGTH - np.mean(START_DISTANCE)) / (count - 1)
    bearing = rng.uniform(-np.pi, np.pi)
    height = rng.uniform(2.0, 3.0)
    way = np.array([[0.0, 0.0, 0.0], [*rng.uniform(*START_DISTANCE) * _direction(bearing), height]])
    for _ in range(n - 1):
        way, bearing = _with_next(rng, way, bearing, mean)
    return way


def _with_next(
    rng: np.random.Generator, way: np.ndarray, bearing: float, mean: float
) -> tuple[np.ndarray, float]:
    """Returns a way with a gate more, and the bearing (rad) of the leg to it; mean: its length."""
    for attempt in range(_LEGS):
        length = np.clip(mean * (1.0 + _SPREAD * rng.standard_normal()), *LEGS)
        turned = bearing + rng.uniform(-_DRAWN_TURN, _DRAWN_TURN)
        slope = rng.uniform(-DESCENT, CLIMB) if way[-1, 2] < _HIGH else rng.uniform(-DESCENT, 0.0)
        height = np.clip(way[-1, 2] + length * np.sin(slope), *HEIGHTS)
        level = np.sqrt(length**2 - (height - way[-1, 2]) ** 2)
        longer = np.vstack([way, [*way[-1, :2] + level * _direction(turned), height]])
        try:
            check_legs_apart(longer)
            return longer, turned
        except RuleError:
            if attempt == _LEGS - 1:
                raise
    raise AssertionError("not reached")


def _make_track(way: np.ndarray, rng: np.random.Generator, name: str) -> SquareTrack:
    """Returns the course along a way, in millimetres and tenths of degrees."""
    legs = np.diff(way, axis=0)
    bearings = np.arctan2(legs[:, 1], legs[:, 0])
    # A gate looks half-way from the leg that leads to it to the one that leads on.
    turns = np.append(wrap_angle(np.diff(bearings)), 0.0)
    yaws = np.rad2deg(bearings + turns / 2)
    slopes = np.arctan2(legs[:, 2], np.linalg.norm(legs[:, :2], axis=1))
    slopes[0] = 0.0  # the way up from the pad
    following = np.append(slopes[1:], 0.0)
    pitches = np.clip(-np.rad2deg(slopes + following) / 2, -PITCH, PITCH)
    heading = np.rad2deg(bearings[0] + 0.9 * rng.uniform(-START_TURN, START_TURN)).round(1) % 360
    start = Start(
        position=[0.0, 0.0, 0.0],
        heading_deg=float(heading),
        pad_tilt_deg=PAD_TILT_DEG,
        pad_tilt_direction_deg=float(heading),
    )
    # + 0.0 takes the sign off -0.0.
    gates = [
        SquareGate((p.round(3) + 0.0).tolist(), float(yaw.round(1) % 360), float(pitch.round(1)))
        for p, yaw, pitch in zip(way[1:], yaws, pitches + 0.0)
    ]
    return SquareTrack(name, surroundings=HALL, start=start, gates=gates)


def _direction(bearing: float) -> np.ndarray:
    return np.array([np.cos(bearing), np.sin(bearing)])
