"""Random courses that obey the rules: rounds between pylons, and winding ways of square gates."""

import collections
from collections.abc import Callable

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from airrace.common.errors import UserError
from airrace.math.angles import wrap_angle
from airrace.math.random import make_generator
from airrace.track import square_rules
from airrace.track.course import Course
from airrace.track.geometry import directions
from airrace.track.layout import Layout
from airrace.track.rules import (
    GATE_COUNTS,
    LENGTHS,
    START_TURN,
    TURN,
    RuleError,
    check_clearances,
    check_layout,
    check_rules,
    check_start,
    check_visibility,
)
from airrace.track.square_gate import SquareGate
from airrace.track.square_rules import CLIMB, DESCENT, HEIGHTS, LEGS, check_square_rules
from airrace.track.square_track import SquareTrack
from airrace.track.start import Start
from airrace.track.track import Gate, Track

DIRECTIONS = {"left": 1, "right": -1}  # to the sign of the turns' sum
SPACING = 10.0  # m, between the pylons of a gate
START_DISTANCE = (10.0, 25.0)  # m, in front of gate 1
START_OFFSET = 3.0  # m, to the side, at most
START_AREA = 50.0  # m, from the origin of the world along x and y, at most
HOVER_HEIGHT = (4.0, 6.0)  # m
PAD_TILT_DEG = 10.0
_LAYOUTS = 2000  # tried before a seed is refused
_STARTS = 20  # tried for each layout
# Of square gates.
_MEAN_LENGTH = 200.0  # m, of a course as raced
_SPREAD = 0.15  # of a leg's length
_COURSES, _LEGS = 200, 30  # tried before a seed is refused, and for each leg of a course
_HIGH = 4.5  # m: from there it goes down, as climbs may be steeper than descents
STRAIGHT_GATES, _STRAIGHT_BEND = 6, 0.1  # of a course that is nearly straight; share of its turns
_DRAWN_TURN = 0.8 * square_rules.TURN  # so that a gate between two legs faces both


def generate_track(seed: int, gates: int | None = None, direction: str | None = None) -> Track:
    """Returns a random track that obeys all of rules.py.

    Turns and lengths are drawn and the lengths moved as little as closes the loop;
    what breaks a rule is drawn again. The same arguments give the same track, and
    so does naming the gates or the direction that were drawn.

    Args:
        seed: at least 0.
        gates: 8, 10, ..., 20; None to draw it from the seed.
        direction: "left" (counter-clockwise) or "right"; None to draw it from the seed.

    Raises:
        UserError: for arguments that no track fits, or if the seed has none.
    """
    _check_seed(seed)
    if gates is not None and gates not in GATE_COUNTS:
        raise UserError(
            f"There is no track of {gates} gates: turns of 45 degrees add up to 360 only for an "
            "even number, 8 at least, and 20 are the most; give one of "
            f"{', '.join(map(str, GATE_COUNTS))}."
        )
    if direction not in (None, *DIRECTIONS):
        raise UserError(f"There is no direction '{direction}'; give left or right.")
    choice = make_generator(seed, "track kind")
    drawn = int(choice.choice(GATE_COUNTS)), str(choice.choice(list(DIRECTIONS)))
    gates, direction = gates or drawn[0], direction or drawn[1]

    rng = make_generator(seed, f"track {gates} {direction}")
    name = f"seed-{seed}-{gates}-{direction}"
    return _first_fair(
        lambda: _draw_track(rng, _draw_layout(rng, gates, DIRECTIONS[direction]), name),
        _LAYOUTS,
        f"Seed {seed} gives no track of {gates} gates to the {direction}",
    )


def generate_square_track(
    seed: int, gates: int | None = None, *, straight: bool = False
) -> SquareTrack:
    """Returns a random course that obeys all of square_rules.py.

    Gate after gate is drawn; what comes near the way so far is drawn again. The same arguments
    give the same course.

    Args:
        seed: at least 0.
        gates: 2 to 20; None to draw 17 to 20 from the seed, or for 6 if straight.
        straight: whether it hardly turns, climbs and descends.

    Raises:
        UserError: for arguments that no course fits, or if the seed has none.
    """
    _check_seed(seed)
    if gates is not None and not 2 <= gates <= square_rules.MOST_GATES:
        raise UserError(
            f"There is no course of {gates} square gates; give 2 to {square_rules.MOST_GATES}."
        )
    drawn = int(make_generator(seed, "square track").choice(square_rules.GATE_COUNTS))
    gates = gates or (STRAIGHT_GATES if straight else drawn)
    kind, bend = ("straight", _STRAIGHT_BEND) if straight else ("square", 1.0)
    rng = make_generator(seed, f"{kind} track {gates}")
    name = f"{kind}-{seed}-{gates}"
    return _first_fair(
        lambda: _draw_square_track(rng, gates, bend, name),
        _COURSES,
        f"Seed {seed} gives no course of {gates} square gates",
    )


def _check_seed(seed):
    if seed < 0:
        raise UserError(f"A seed cannot be negative, as {seed} is; give 0 or more.")


def _first_fair[C: Course](draw: Callable[[], C], tries: int, failure: str) -> C:
    """Returns the first course that keeps the rules, of so many that draw() returns.

    Raises:
        UserError: if none does: the failure, with the rule that most of them broke.
    """
    reasons = collections.Counter()
    for _ in range(tries):
        try:
            return draw()
        except RuleError as e:
            reasons[e.rule] += 1
    rule, count = reasons.most_common(1)[0]
    raise UserError(
        f"{failure}: of {tries} layouts {count} broke the rule on {rule}; take another seed."
    )


def _draw_layout(rng: np.random.Generator, n: int, sign: int) -> Layout:
    """Returns a layout that keeps the rules; gate 1 is at the origin."""
    turns = np.full(n, sign)
    turns[rng.permutation(n)[: n // 2 - 4]] = -sign  # the turns add up to 8 sign
    first = np.deg2rad(rng.integers(360))
    headings = first + TURN * np.concatenate([[0], np.cumsum(turns[:-1])])
    lengths = _close(directions(headings), np.exp(rng.uniform(*np.log(LENGTHS), n)))  # type: ignore[call-overload]
    steps = lengths[:, None] * directions(headings)
    left = np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
    layout = Layout(left, headings, np.full(n, SPACING))
    check_layout(layout)
    check_clearances(layout)
    check_visibility(layout)
    return layout


def _close(forward: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Returns lengths of legs in directions (n, 2) that lead back to gate 1, (n,) m.

    They are the nearest to those wanted, (n,) m, by the squares of the relative changes.
    """
    program = MathematicalProgram()
    lengths = program.NewContinuousVariables(len(forward))
    program.AddBoundingBoxConstraint(*LENGTHS, lengths)
    program.AddLinearEqualityConstraint(forward.T, np.zeros(2), lengths)
    program.AddQuadraticErrorCost(np.diag(wanted**-2.0), wanted, lengths)
    result = ClarabelSolver().Solve(program)
    if not result.is_success():
        raise RuleError("closure", "no lengths of the legs close it")
    return np.clip(result.GetSolution(lengths), *LENGTHS)


def _draw_track(rng: np.random.Generator, layout: Layout, name: str) -> Track:
    """Returns the track of a layout with a start from which gate 1 is found."""
    for attempt in range(_STARTS):
        track = _place(rng, layout, name)
        try:
            check_start(track, Layout.of(track))
            break
        except RuleError:
            if attempt == _STARTS - 1:
                raise
    # Once more as a whole, as it will be written.
    track.check()
    check_rules(track)
    return track


def _place(rng: np.random.Generator, layout: Layout, name: str) -> Track:
    """Returns a track at a random place in the world, in millimetres and degrees."""
    distance, offset = rng.uniform(*START_DISTANCE), rng.uniform(-START_OFFSET, START_OFFSET)
    to_gate = distance * layout.forward[0] + offset * layout.rightward[0]
    heading = np.arctan2(to_gate[1], to_gate[0]) + rng.uniform(-START_TURN, START_TURN)
    start = Start(
        position=[*rng.uniform(-START_AREA, START_AREA, 2).round(1).tolist(), 0.0],
        heading_deg=round(float(np.rad2deg(heading)), 1) % 360,
        pad_tilt_deg=round(rng.uniform(0.0, PAD_TILT_DEG), 1),
        pad_tilt_direction_deg=float(rng.integers(360)),
    )
    left = np.round(layout.left - layout.middle[0] + to_gate + start.position[:2], 3)
    headings_deg = np.rad2deg(layout.headings).round() % 360
    # + 0.0 takes the sign off -0.0.
    gates = [Gate(p, h, SPACING) for p, h in zip((left + 0.0).tolist(), headings_deg.tolist())]
    return Track(name, start, round(rng.uniform(*HOVER_HEIGHT), 1), gates)


def _draw_way(rng: np.random.Generator, n: int, bend: float) -> np.ndarray:
    """Returns the pad and n gates, (n + 1, 3) m; RuleError: if the course runs into itself.

    Args: bend: share of turns and slopes.
    """
    count = n if n in square_rules.GATE_COUNTS else square_rules.GATE_COUNTS[0]
    mean = (_MEAN_LENGTH - np.mean(square_rules.START_DISTANCE)) / (count - 1)
    bearing = rng.uniform(-np.pi, np.pi)
    height = rng.uniform(2.0, 3.0)
    first = rng.uniform(*square_rules.START_DISTANCE) * directions(bearing)
    way = np.array([[0.0, 0.0, 0.0], [*first, height]])
    for _ in range(n - 1):
        way, bearing = _with_next(rng, way, bearing, mean, bend)
    return way


def _with_next(
    rng: np.random.Generator, way: np.ndarray, bearing: float, mean: float, bend: float
) -> tuple[np.ndarray, float]:
    """Returns a way with a gate more, and the bearing (rad) of the leg to it; mean: its length."""
    for attempt in range(_LEGS):
        length = np.clip(mean * (1.0 + _SPREAD * rng.standard_normal()), *LEGS)
        turned = bearing + bend * rng.uniform(-_DRAWN_TURN, _DRAWN_TURN)
        slope = rng.uniform(-DESCENT, CLIMB) if way[-1, 2] < _HIGH else rng.uniform(-DESCENT, 0.0)
        height = np.clip(way[-1, 2] + length * np.sin(bend * slope), *HEIGHTS)
        level = np.sqrt(length**2 - (height - way[-1, 2]) ** 2)
        longer = np.vstack([way, [*way[-1, :2] + level * directions(turned), height]])
        try:
            square_rules.check_legs_apart(longer)
            return longer, turned
        except RuleError:
            if attempt == _LEGS - 1:
                raise
    raise AssertionError("not reached")


def _draw_square_track(rng: np.random.Generator, n: int, bend: float, name: str) -> SquareTrack:
    """Returns a course along a random way, in millimetres and tenths of degrees."""
    way = _draw_way(rng, n, bend)
    legs = np.diff(way, axis=0)
    bearings = np.arctan2(legs[:, 1], legs[:, 0])
    # A gate looks half-way from the leg that leads to it to the one that leads on.
    turns = np.append(wrap_angle(np.diff(bearings)), 0.0)
    yaws = np.rad2deg(bearings + turns / 2)
    slopes = np.arctan2(legs[:, 2], np.linalg.norm(legs[:, :2], axis=1))
    slopes[0] = 0.0  # the way up from the pad
    following = np.append(slopes[1:], 0.0)
    pitches = np.clip(-np.rad2deg(slopes + following) / 2, -square_rules.PITCH, square_rules.PITCH)
    turn = 0.9 * rng.uniform(-square_rules.START_TURN, square_rules.START_TURN)
    heading = float(np.rad2deg(bearings[0] + turn).round(1) % 360)
    start = Start([0.0, 0.0, 0.0], heading, square_rules.PAD_TILT_DEG, heading)
    # + 0.0 takes the sign off -0.0.
    gates = [
        SquareGate((p.round(3) + 0.0).tolist(), float(yaw.round(1) % 360), float(pitch.round(1)))
        for p, yaw, pitch in zip(way[1:], yaws, pitches + 0.0)
    ]
    track = SquareTrack(name, start=start, gates=gates)
    track.check()
    check_square_rules(track)
    return track
