"""The experiments of benchmarks/control.py: each a pure function to a row of numbers.

Every one returns its arguments and what it measured. What a flight has not got, such as the
touch-down of one that stays in the air, is NaN; what never happened has the time infinity.
"""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.math.random import make_generator
from airrace.scenario import load_scenario
from airrace.vehicle import load_vehicle
from airrace.vehicle.disturbances import RotorFailure
from airrace.vehicle.rotor_loss import Remaining
from benchmarks.whole_race import fly_race
from tests.worlds.flight import (
    PERIOD,
    deviations,
    fly,
    hover_reference,
    lap_reference,
    racing_lap,
    start_on,
)

MAX_RATE = 10.0  # rad/s, to recover from
_SETTLING = 6.0  # s, after which a drone stays as it is
_RUN_IN = 5.0  # s, before a lap counts
_LOSS_TIME = 4.0  # s, when the errors of the start have decayed
_AFTER_LOSS = 10.0  # s, of flying on
_MOST_DESCENT = 60.0  # s
_HOVER_HEIGHTS = {"Default": 10.0, "StarOne": 8.0}  # m, when rotors are lost in a hover
_RECOVERY_HEIGHT = 30.0  # m


class Case(NamedTuple):
    """What is flown.

    Attributes:
        name: what to call it.
        scenario: name of a shipped scenario.
        text: YAML of a scenario on top of it.
        seeds: how many seeds.
    """

    name: str
    scenario: str = "Defaults"
    text: str = ""
    seeds: int = 1

    def load(self):
        """Returns its Scenario."""
        return load_scenario(filename="races", scenario_name=self.scenario, scenario_text=self.text)


def recovery(drone: str, noise: str, index: int) -> dict:
    """Lets a drone go with an attitude and an angular velocity, to hover where it is.

    Args:
        drone: its name.
        noise: the scenario's state_noise.
        index: which attitude: the first four are upside down, by roll and by
            pitch, at rest and with a yaw rate.
    """
    scenario = load_scenario(scenario_text=f"{{drone: {drone}, state_noise: {noise}}}")
    scenario.seed = index if noise != "none" else 0  # one world is built faster than many
    R_WB, w_WB = _random_start(index)
    X_WB = RigidTransform(R_WB, [0.0, 0.0, _RECOVERY_HEIGHT])
    flown = fly(scenario, hover_reference(_RECOVERY_HEIGHT), _SETTLING, X_WB=X_WB, w_WB=w_WB)
    w_B = np.einsum("nij,ni->nj", flown.rotations, flown.angular_velocities)
    # In a hover, the noise of the state alone now and then brings higher rates.
    steady = _for_half_a_second(np.hypot(w_B[:, 0], w_B[:, 1]) < 0.5)
    hovers = _from_then_on((flown.tilts < 5.0) & (flown.speeds < 0.5)) & steady
    return {
        "drone": drone,
        "noise": noise,
        "index": index,
        "hover_s": _first(hovers, flown.times),
        "yaw_stopped_s": _first(_from_then_on(np.abs(w_B[:, 2]) < 0.5), flown.times),
        "height_lost_m": float(_RECOVERY_HEIGHT - flown.positions[:, 2].min()),
        "dnf_reason": flown.status.dnf_reason,
    }


def _random_start(index):
    """Returns a uniform rotation R_WB, and an angular velocity uniform in a ball (rad/s)."""
    if index < 4:
        turn = RollPitchYaw(np.pi, 0.0, 0.0) if index % 2 == 0 else RollPitchYaw(0.0, np.pi, 0.0)
        return turn.ToRotationMatrix(), np.array([0.0, 0.0, MAX_RATE * (index >= 2)])
    generator = make_generator(index, "recovery")
    quaternion, direction = generator.normal(size=4), generator.normal(size=3)
    rate = MAX_RATE * np.cbrt(generator.uniform())
    R_WB = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    return R_WB, rate / np.linalg.norm(direction) * direction


def _from_then_on(holds) -> np.ndarray:
    """Returns whether something holds from each sample on to the end."""
    return np.logical_and.accumulate(holds[::-1])[::-1]


def _for_half_a_second(holds) -> np.ndarray:
    """Returns whether something holds from each sample on for half a second."""
    failures = np.concatenate([[0], np.cumsum(~holds)])
    later = np.minimum(np.arange(len(holds)) + round(0.5 / PERIOD), len(holds))
    return failures[later] == failures[:-1]


def _first(holds, times) -> float:
    """Returns when something first holds (s), or infinity."""
    return float(times[holds.argmax()]) if holds.any() else np.inf


def tracking(drone: str, case: Case, noise: str, seed: int, duration: float | None = None) -> dict:
    """Flies one racing lap, after a run-in.

    Args:
        drone: its name.
        case: the scenario.
        noise: the scenario's state_noise.
        seed: of the scenario.
        duration: of what counts (s); None for the whole lap.
    """
    scenario = case.load()
    scenario.drone, scenario.state_noise, scenario.seed = drone, noise, seed
    lap = racing_lap(drone)
    reference = lap_reference(lap, -_RUN_IN / lap.duration)
    flown = fly(scenario, reference, _RUN_IN + (duration or lap.duration), **start_on(reference))
    errors = deviations(flown, reference)[flown.times > _RUN_IN]
    over = flown.status.over
    return {
        "drone": drone,
        "case": case.name,
        "noise": noise,
        "seed": seed,
        "rms_m": np.nan if over else float(np.sqrt(np.mean(errors**2))),
        "max_m": np.nan if over else float(errors.max()),
        "dnf_reason": flown.status.dnf_reason,
    }


def loss(drone: str, rotors: tuple, phase: float | None, drag: float) -> dict:
    """Stops rotors in flight: those drones that can, fly on, the others come down.

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
    found_at = max(flown.losses[rotor - 1] for rotor in rotors)
    stays = can_fly and not flown.status.over
    landed = (flown.status.dnf_reason or "").startswith("hit the ground")
    vx, vy, vz = flown.velocities[-1].tolist()
    return {
        "drone": drone,
        "rotors": rotors,
        "phase": phase,
        "drag": drag,
        "can_fly": can_fly,
        "height_m": float(flown.positions[~after][-1, 2]),
        "found_after_s": float(found_at - _LOSS_TIME),
        "deviation_m": float(deviations(flown, reference)[after].max()) if stays else np.nan,
        "dnf_reason": flown.status.dnf_reason,
        "descent_s": flown.status.end_time - _LOSS_TIME if landed else np.nan,
        "fastest_sink_m_s": float(-flown.velocities[after, 2].min()),
        "sink_m_s": -vz if landed else np.nan,
        "side_m_s": float(np.hypot(vx, vy)) if landed else np.nan,
        "tilt_deg": float(flown.tilts[-1]) if landed else np.nan,
    }


def race(drone: str, case: Case, laps: int) -> dict:
    """Flies a whole race from pixels.

    Args:
        drone: its name.
        case: the scenario.
        laps: to fly.
    """
    scenario = case.load()
    scenario.drone, scenario.laps = drone, laps
    scenario.recording.content = "none"
    with tempfile.TemporaryDirectory() as directory:
        result = fly_race(scenario, Path(directory))
    failed_at = min((f.time for f in scenario.rotor_failures), default=np.inf)
    flown = result["laps"]
    before = [lap["time_s"] for lap in flown if lap["start_s"] + lap["time_s"] <= failed_at]
    after = [lap["time_s"] for lap in flown if lap["start_s"] >= failed_at]
    return {
        "drone": drone,
        "case": case.name,
        "laps": laps,
        "flown": len(flown),
        "finished": result["finished"],
        "dnf_reason": result["dnf_reason"],
        "collisions": result["collisions"],
        "mean_lap_s": result["mean_lap_s"],
        "mean_before_s": float(np.mean(before)) if before else np.nan,
        "mean_after_s": float(np.mean(after)) if after else np.nan,
        "worst_offset_m": max((max(lap["gate_offsets_m"]) for lap in flown), default=np.nan),
    }
