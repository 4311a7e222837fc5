"""Random tracks that obey the rules."""

import collections

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from airrace.common.errors import UserError
from airrace.math.random import make_generator
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


def generate_track(seed: int, gates: int | None = None, direction: str | None = None) -> Track:
    """Returns a random track that obeys all of rules.py.

    Turns and lengths are drawn and the lengths moved as little as closes the loop;
    what breaks a rule is drawn again. The same arguments give the same track, and
    so does naming the gates or the direction that were drawn.

    Args:
        seed: at least 0.
        gates: 8, 10, ..., 20; None to draw it from the seed.
        direction: "left" for a counter-clockwise track, "right" for a clockwise
            one; None to draw it from the seed.

    Raises:
        UserError: for arguments that no track fits, or if the seed has none.
    """
    if seed < 0:
        raise UserError(f"A seed cannot be negative, as {seed} is; give 0 or more.")
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
    reasons = collections.Counter()
    for _ in range(_LAYOUTS):
        try:
            layout = _draw_layout(rng, gates, DIRECTIONS[direction])
            return _draw_track(rng, layout, f"seed-{seed}-{gates}-{direction}")
        except RuleError as e:
            reasons[e.rule] += 1
    rule, count = reasons.most_common(1)[0]
    raise UserError(
        f"Seed {seed} gives no track of {gates} gates to the {direction}: of {_LAYOUTS} layouts "
        f"{count} broke the rule on {rule}; take another seed."
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
    """Returns lengths of the legs that lead back to gate 1, (n,) m.

    They are the nearest to those wanted, by the squares of the relative changes.

    Args:
        forward: directions of the legs, (n, 2).
        wanted: (n,) m.
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
