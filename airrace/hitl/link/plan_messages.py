"""The lap plan as a message."""

import dataclasses as dc
import json
import math

import numpy as np
from pydrake.polynomial import Polynomial
from pydrake.trajectories import PiecewisePolynomial

from airrace import lcmtypes
from airrace.hitl.link.codec import Codec, check_finite
from airrace.hitl.link.packets import MALFORMED, NOT_FINITE, Dropped
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.trajopt.flat_trajectory import FlatTrajectory, segment_coefficients
from airrace.trajopt.min_snap.circuit import Circuit

_ROWS = 4
_NUMBERS = [field.name for field in dc.fields(PlanSummary) if "float" in str(field.type)]
_LEAST_STEP, _MOST = 1e-6, 1e12  # s between breaks, and of any coefficient


def encode_lap_plan(plan: LapPlan) -> lcmtypes.lcmt_lap_plan:
    """Args: plan: of a lap, or NO_PLAN."""
    message = lcmtypes.lcmt_lap_plan()
    if plan is NO_PLAN:
        return message
    circuit = plan.circuit
    message.lap, message.start_time, message.phase = plan.lap, plan.start_time, plan.phase
    message.entry, message.circuit = _encoded(plan.entry), _encoded(circuit)
    message.num_gates = len(circuit.headings)
    # The last time is the duration, which follows from the breaks.
    message.gate_times = [float(t) for t in circuit.gate_times[:-1]]
    message.headings = [float(h) for h in circuit.headings]
    message.num_approaches = len(circuit.approach)
    message.approach_gates = [int(gate) for gate in circuit.approach]
    message.approach_distances = [float(d) for d in circuit.approach.values()]
    message.summary = json.dumps(
        dc.asdict(plan.summary), allow_nan=False, default=lambda number: number.item()
    )
    return message


def decode_lap_plan(message) -> LapPlan:
    """Returns the plan, or NO_PLAN itself."""
    if message.lap == 0:
        return NO_PLAN
    check_finite(
        [message.start_time, message.phase],
        message.gate_times,
        message.headings,
        message.approach_distances,
    )
    if message.lap < 0 or message.num_gates < 2:
        raise Dropped(MALFORMED)
    lap = _decoded(message.circuit)
    gate_times = (*message.gate_times, lap.end_time())
    return LapPlan(
        lap=message.lap,
        start_time=message.start_time,
        entry=FlatTrajectory(_decoded(message.entry)),
        circuit=Circuit(
            lap,
            gate_times,
            message.headings,
            dict(zip(message.approach_gates, message.approach_distances)),
        ),
        phase=message.phase,
        summary=_decoded_summary(message.summary),
    )


def _decoded_summary(text: str) -> PlanSummary:
    try:
        values = json.loads(text)
        summary = PlanSummary(
            **{
                name: tuple(value) if isinstance(value, list) else value
                for name, value in values.items()
            }
        )
        numbers = [getattr(summary, name) for name in _NUMBERS]
        numbers += [*summary.max_thrusts, *summary.min_thrusts]
        if not all(number is None or math.isfinite(number) for number in numbers):
            raise Dropped(NOT_FINITE)
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise Dropped(MALFORMED) from None
    return summary


def _encoded(trajectory: FlatTrajectory) -> lcmtypes.lcmt_polynomials:
    numbers = segment_coefficients(trajectory.polynomial)
    message = lcmtypes.lcmt_polynomials()
    message.breaks = list(trajectory.breaks)
    message.num_breaks, message.num_numbers = len(message.breaks), numbers.size
    message.numbers = numbers.ravel().tolist()
    return message


def _decoded(message) -> PiecewisePolynomial:
    segments = message.num_breaks - 1
    if segments < 1 or not message.numbers or len(message.numbers) % (segments * _ROWS):
        raise Dropped(MALFORMED)
    check_finite(message.breaks, message.numbers)
    steps = np.diff(message.breaks)
    if (
        message.breaks[0] != 0.0
        or np.any(steps < _LEAST_STEP)
        or np.max(np.abs(message.numbers)) > _MOST
    ):
        raise Dropped(MALFORMED)  # Drake would end the process
    numbers = np.reshape(message.numbers, (segments, _ROWS, -1))
    return PiecewisePolynomial(
        [np.array([[Polynomial(row)] for row in segment]) for segment in numbers],
        list(message.breaks),
    )


LAP_PLAN = Codec(lcmtypes.lcmt_lap_plan, encode_lap_plan, decode_lap_plan)
