"""The experiments of benchmarks/control.py: each a pure function to a row of numbers.

Every one returns its arguments and what it measured, as a flat dictionary for
JSON. What a flight has not got, such as the touch-down of one that stays in the
air, is None.
"""

import tempfile
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.diagrams.race import run_race
from airrace.math.random import make_generator
from airrace.scenario import load_scenario
from airrace.vehicle import load_vehicle
from airrace.vehicle.disturbances import RotorFailure
from airrace.vehicle.rotor_loss import Remaining
from benchmarks.flights import (
    PERIOD,
    deviations,
    fly,
    hover_reference,
    lap_reference,
    racing_lap,
    start_on,
)

MAX_RATE = 10.0  # rad/s, to recover from
_SETTLING = 6.0  # s, of which the end tells what is for good
_RUN_IN = 5.0  # s, before a lap counts
_LOSS_TIME = 4.0  # s, by when what the start brought has faded
_AFTER_LOSS = 10.0  # s, of flying on
_MOST_DESCENT = 60.0  # s
_HOVER_HEIGHTS = {"Default": 10.0, "StarOne": 8.0}  # m, when rotors are lost in a hover
_RECOVERY_HEIGHT = 30.0  # m


def recovery(drone: str, noise: str, index: int) -> dict:
    """Lets a drone go with an attitude and a spin, to hover where it is.

    Args:
        drone: its name.
        noise: the scenario's state_noise.
        index: which attitude: the first four are upside down, by roll and by
            pitch, at rest and with a yaw spin.
    """
    scenario = load_scenario(scenario_text=f"{{drone: {drone}, state_noise: {noise}}}")
    scenario.seed = index if noise != "none" else 0  # one world is built faster than many
    R_WB, w_WB = _thrown(index)
    flown = fly(
        scenario,
        hover_reference(_RECOVERY_HEIGHT),
        _SETTLING,
        X_WB=RigidTransform(R_WB, [0.0, 0.0, _RECOVERY_HEIGHT]),
        w_WB=w_WB,
    )
    # Angular velocities in B; those of the states are in W.
    w = np.einsum("nij,ni->nj", flown.rotations, flown.states[:, 7:10])
    speeds = np.linalg.norm(flown.states[:, 10:13], axis=1)
    # In a hover, the noise of the state alone now and then brings higher rates.
    steady = _for_a_while(np.hypot(w[:, 0], w[:, 1]) < 0.5)
    hovers = _for_good((flown.tilts < 5.0) & (speeds < 0.5)) & steady
    return {
        "drone": drone,
        "noise": noise,
        "index": index,
        "hover_s": _first(hovers, flown.times),
        "yaw_stopped_s": _first(_for_good(np.abs(w[:, 2]) < 0.5), flown.times),
        "height_lost_m": float(_RECOVERY_HEIGHT - flown.states[:, 6].min()),
        "dnf_reason": flown.report.dnf_reason,
    }


def _thrown(index):
    """Returns a rotation R_WB and an angular velocity (rad/s).

    Rotations are uniform, angular velocities uniform in a ball.
    """
    if index < 4:
        turn = RollPitchYaw(np.pi, 0.0, 0.0) if index % 2 == 0 else RollPitchYaw(0.0, np.pi, 0.0)
        return turn.ToRotationMatrix(), np.array([0.0, 0.0, MAX_RATE * (index >= 2)])
    generator = make_generator(index, "recovery")
    quaternion, direction = generator.normal(size=4), generator.normal(size=3)
    rate = MAX_RATE * np.cbrt(generator.uniform())
    R_WB = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    return R_WB, rate / np.linalg.norm(direction) * direction


def _for_good(holds) -> np.ndarray:
    """Returns whether something holds from each look on to the end."""
    return np.logical_and.accumulate(holds[::-1])[::-1]


def _for_a_while(holds) -> np.ndarray:
    """Returns whether something holds from each look on for half a second."""
    failures = np.concatenate([[0], np.cumsum(~holds)])
    later = np.minimum(np.arange(len(holds)) + round(0.5 / PERIOD), len(holds))
    return failures[later] == failures[:-1]


def _first(holds, times) -> float | None:
    """Returns when something first holds (s), or None if never."""
    return float(times[holds.argmax()]) if holds.any() else None


def tracking(
    drone: str,
    case: str,
    noise: str,
    scenario_name: str,
    scenario_text: str,
    seed: int,
    duration: float | None = None,
) -> dict:
    """Flies one racing lap, after a run-in.

    Args:
        drone: its name.
        case: what to call it.
        noise: the scenario's state_noise.
        scenario_name: of a shipped scenario.
        scenario_text: YAML of a scenario on top of it.
        seed: of the scenario.
        duration: of what counts (s); None for the whole lap.
    """
    scenario = load_scenario(
        filename="races", scenario_name=scenario_name, scenario_text=scenario_text
    )
    scenario.drone, scenario.state_noise, scenario.seed = drone, noise, seed
    lap = racing_lap(drone)
    reference = lap_reference(lap, -_RUN_IN / lap.duration)
    flown = fly(scenario, reference, _RUN_IN + (duration or lap.duration), **start_on(reference))
    errors = deviations(flown, reference)[flown.times > _RUN_IN]
    over = flown.report.over
    return {
        "drone": drone,
        "case": case,
        "noise": noise,
        "seed": seed,
        "rms_m": None if over else float(np.sqrt(np.mean(errors**2))),
        "max_m": None if over else float(errors.max()),
        "dnf_reason": flown.report.dnf_reason,
    }


def loss(drone: str, rotors: list, phase: float | None, drag: float) -> dict:
    """Stops rotors in flight: those that can, fly on, the others come down.

    Args:
        drone: its name.
        rotors: their numbers, from 1.
        phase: the share of the racing lap at which it happens, or None: in a hover.
        drag: share of the vehicle's drag that acts.
    """
    scenario = load_scenario(scenario_text=f"{{drone: {drone}, disturbances: {{drag: {drag}}}}}")
    scenario.rotor_failures = [RotorFailure(rotor, _LOSS_TIME) for rotor in rotors]
    vehicle, _ = load_vehicle(drone)
    can_fly = Remaining(vehicle, [i + 1 not in rotors for i in range(len(vehicle.rotors))]).can_fly
    if phase is None:
        reference = hover_reference(_HOVER_HEIGHTS[drone])
    else:
        lap = racing_lap(drone)
        reference = lap_reference(lap, phase - _LOSS_TIME / lap.duration)
    duration = _LOSS_TIME + (_AFTER_LOSS if can_fly else _MOST_DESCENT)
    flown = fly(scenario, reference, duration, **start_on(reference))
    after = flown.times > _LOSS_TIME
    found_after = flown.losses[[rotor - 1 for rotor in rotors]].max() - _LOSS_TIME
    stays = can_fly and not flown.report.over
    landed = (flown.report.dnf_reason or "").startswith("hit the ground")
    vx, vy, vz = flown.states[-1, 10:13].tolist()
    return {
        "drone": drone,
        "rotors": rotors,
        "phase": phase,
        "drag": drag,
        "can_fly": can_fly,
        "height_m": float(flown.states[~after][-1, 6]),
        "found_after_s": float(found_after) if np.isfinite(found_after) else None,
        "deviation_m": float(deviations(flown, reference)[after].max()) if stays else None,
        "end": flown.report.dnf_reason,
        "descent_s": flown.report.end_time - _LOSS_TIME if landed else None,
        "fastest_sink_m_s": float(-flown.states[after, 12].min()),
        "sink_m_s": -vz if landed else None,
        "side_m_s": float(np.hypot(vx, vy)) if landed else None,
        "tilt_deg": float(flown.tilts[-1]) if landed else None,
    }


def race(drone: str, case: str, scenario_name: str, scenario_text: str, laps: int) -> dict:
    """Flies a whole race from pixels.

    Args:
        drone: its name.
        case: what to call it.
        scenario_name: of a shipped scenario.
        scenario_text: YAML of a scenario on top of it.
        laps: to fly.
    """
    scenario = load_scenario(
        filename="races", scenario_name=scenario_name, scenario_text=scenario_text
    )
    scenario.drone, scenario.laps = drone, laps
    scenario.recording.content = "none"
    with tempfile.TemporaryDirectory() as directory:
        result = run_race(scenario, Path(directory))
    failed_at = min((f.time for f in scenario.rotor_failures), default=np.inf)
    flown = result["laps"]
    before = [lap["time_s"] for lap in flown if lap["start_s"] + lap["time_s"] <= failed_at]
    after = [lap["time_s"] for lap in flown if lap["start_s"] >= failed_at]
    return {
        "drone": drone,
        "case": case,
        "laps": laps,
        "finished": result["finished"],
        "dnf_reason": result["dnf_reason"],
        "collisions": result["collisions"],
        "mean_lap_s": result["mean_lap_s"],
        "lap_times_s": [lap["time_s"] for lap in flown],
        "mean_before_s": float(np.mean(before)) if before else None,
        "mean_after_s": float(np.mean(after)) if after else None,
        "worst_offset_m": max((max(lap["gate_offsets_m"]) for lap in flown), default=None),
    }
