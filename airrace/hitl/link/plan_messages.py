"""Lap plans, and what is to be planned, as messages."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from airrace import lcmtypes
from airrace.hitl.link.codec import Codec, field_codec
from airrace.hitl.link.messages import GATE
from airrace.hitl.link.packets import MALFORMED, Dropped
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.planning.laps import PlanRequest
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.trajopt.min_snap.circuit import Circuit

if TYPE_CHECKING:
    from airrace.lcmtypes import lcmt_lap_plan

_ROWS = 4
_LEAST_STEP, _MOST = 1e-6, 1e12  # s between breaks, and of any coefficient


class _Polynomials(NamedTuple):
    breaks: np.ndarray  # (n + 1,) s
    numbers: np.ndarray  # coefficients of n segments, flat


class _Circuit(NamedTuple):
    polynomial: FlatTrajectory
    gate_times: tuple
    headings: tuple
    approach: dict


def _split(trajectory: FlatTrajectory) -> _Polynomials:
    breaks, coefficients = trajectory.segments
    return _Polynomials(breaks, coefficients.ravel())


def _joined(parts: _Polynomials) -> FlatTrajectory:
    breaks, numbers = parts
    segments = len(breaks) - 1
    if segments < 1 or not len(numbers) or len(numbers) % (segments * _ROWS):
        raise Dropped(MALFORMED)
    is_sound = breaks[0] == 0.0 and np.all(np.diff(breaks) >= _LEAST_STEP)
    if not is_sound or np.max(np.abs(numbers)) > _MOST:
        raise Dropped(MALFORMED)  # Drake would end the process
    return FlatTrajectory.of_segments(breaks, numbers.reshape(segments, _ROWS, -1))


def _parts_of(circuit: Circuit) -> _Circuit:
    return _Circuit(circuit, circuit.gate_times, circuit.headings, circuit.approach)


def _checked_circuit(parts: _Circuit) -> Circuit:
    if len(parts.headings) < 2 or len(parts.gate_times) != len(parts.headings) + 1:
        raise Dropped(MALFORMED)
    return Circuit.of_path(*parts)


_PATH = field_codec(_Polynomials, lcmtypes.lcmt_polynomials).of(_split, _joined)
_CIRCUIT = field_codec(_Circuit, lcmtypes.lcmt_circuit, parts={"polynomial": _PATH})
_PLAN = field_codec(
    LapPlan,
    lcmtypes.lcmt_lap_plan,
    parts={
        "entry": _PATH,
        "circuit": _CIRCUIT.of(_parts_of, _checked_circuit),
        "summary": field_codec(PlanSummary, lcmtypes.lcmt_plan_summary),
    },
)


def encode_lap_plan(plan: LapPlan) -> lcmtypes.lcmt_lap_plan:
    """Args: plan: of a lap, or NO_PLAN."""
    return lcmtypes.lcmt_lap_plan() if plan is NO_PLAN else _PLAN.encode(plan)


def decode_lap_plan(message: "lcmt_lap_plan") -> LapPlan:
    """Returns the plan, or NO_PLAN itself."""
    if message.lap < 0:
        raise Dropped(MALFORMED)
    return _PLAN.decode(message) if message.lap else NO_PLAN


LAP_PLAN = Codec(lcmtypes.lcmt_lap_plan, encode_lap_plan, decode_lap_plan)
PLAN_REQUEST = field_codec(
    PlanRequest, lcmtypes.lcmt_lap_problem, parts={"gates": GATE, "old": LAP_PLAN}
)
