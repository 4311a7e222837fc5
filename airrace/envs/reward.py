"""The reward of a step, and when an episode is over, for one drone and compiled loops."""

import math
from typing import NamedTuple

import numpy as np

from airrace.common.jit import compilable
from airrace.math.triples import difference, dot
from airrace.systems.sensing.contact_names import TAKE_OFF
from airrace.track import Track
from airrace.track.gate_opening import find

# How an episode stands after a step.
RUNNING, COLLISION, MISSED_GATE, LEFT_ARENA, FINISHED, DIVERGED = range(6)
REASONS = ("", "collision", "missed gate", "left the arena", "finished", "the simulation failed")
NEVER = 2**62  # gates to pass, of an episode without a last lap


class RewardWeights(NamedTuple):
    """What a step is worth; see judge()."""

    progress: float = 1.0  #: of a metre nearer to the next gate
    rates: float = 5e-4  #: cost of squared body rates, of a (rad/s)^2 a step
    gate: float = 10.0  #: of a gate that was passed
    failure: float = -10.0  #: of the end by a collision, a missed gate, or an arena left


@compilable
def of_a_piece(weights: RewardWeights, pieces: int) -> RewardWeights:
    """Returns the weights for one of the pieces that a step is judged in."""
    return RewardWeights(weights.progress, weights.rates / pieces, weights.gate, weights.failure)


class CourseNumbers(NamedTuple):
    """What the flight is judged by."""

    gates: np.ndarray  #: numbers of their openings, (n, 15), see Opening
    goal: int  #: number of gates to pass until it is finished
    take_off_height: float  #: of the body's origin, above which the drone flies (m)
    arena_min: np.ndarray  #: x and y of the arena (m), (2,)
    arena_max: np.ndarray  #: its x, y and z (m), (3,)


class Judgement(NamedTuple):
    """What a step comes to."""

    reward: float  #: see judge()
    outcome: int  #: RUNNING, or why the episode is over: an index of REASONS
    passed: int  #: gates that were passed so far
    airborne: bool  #: whether the drone has taken off


def make_course(
    track: Track, *, goal: int, arena_margin: float, standing_height: float
) -> CourseNumbers:
    """Returns a track as judge() takes it.

    Args:
        goal: number of gates to pass: n laps from gate 1 to gate 1 are n times all, and one.
        arena_margin: how far beyond the outermost pylons, and above the ground, it reaches (m).
        standing_height: of the body's origin when the drone stands on its pad (m).
    """
    arena_min, arena_max = track.arena(arena_margin)
    height = float(standing_height + TAKE_OFF)
    return CourseNumbers(track.openings(), int(goal), height, arena_min, arena_max)


@compilable
def judge(
    before: np.ndarray,
    p: np.ndarray,
    w: np.ndarray,
    touched: bool,
    passed: int,
    airborne: bool,
    course: CourseNumbers,
    weights: RewardWeights,
) -> Judgement:
    """Returns reward and outcome of one step.

    The reward is that of Song, Steinweg, Kaufmann and Scaramuzza, "Autonomous drone racing with
    deep reinforcement learning" (IROS 2021), equation (2): the progress |q - c| - |p - c| from q
    to p towards the midpoint c of the gate that is next when the step begins, less a cost of the
    body's rates. A gate passed adds to it, and so does, negative, an end by a failure.

    A gate is passed if the straight line from q to p passes its opening from the front. If that
    passes the gate's plane from the front anywhere else, the gate was missed: from where its
    predecessor stands, every way through leads through the plane just once.

    Args:
        before: q = p_WB at the beginning of the step (m), (3,). p: at its end, (3,).
        w: angular velocity at its end, in any axes (rad/s), (3,).
        touched: whether anything pushed the drone during the step.
        passed: gates that were passed before. airborne: whether the drone had taken off before.
        course: with the gates where they stand.
    """
    airborne = airborne or p[2] > course.take_off_height
    gate = course.gates[passed % len(course.gates)]
    share, _ = find(gate, before, p)
    from_gate, to_gate = difference(before, gate), difference(p, gate)
    progress = math.sqrt(dot(from_gate, from_gate)) - math.sqrt(dot(to_gate, to_gate))
    reward = weights.progress * progress - weights.rates * dot(w, w)
    lowest, highest = course.arena_min, course.arena_max
    is_inside = lowest[0] < p[0] < highest[0] and lowest[1] < p[1] < highest[1]
    outcome = RUNNING
    if not math.isfinite(p[0] + p[1] + p[2]):
        reward, outcome = 0.0, DIVERGED
    elif touched and airborne:
        outcome = COLLISION
    elif not math.isnan(share):
        passed += 1
        reward += weights.gate
        if passed >= course.goal:
            outcome = FINISHED
    elif dot(gate[3:6], from_gate) < 0.0 <= dot(gate[3:6], to_gate):
        outcome = MISSED_GATE
    elif not (is_inside and p[2] < highest[2]):
        outcome = LEFT_ARENA
    if outcome not in (RUNNING, FINISHED):
        reward += weights.failure
    return Judgement(reward, outcome, passed, airborne)
