"""The tables of benchmarks/control.py, each from rows of benchmarks/experiments.py."""

import numpy as np
from pydrake.solvers import MathematicalProgram, Solve
from rich.table import Table

from airrace.vehicle import GRAVITY, Vehicle, load_vehicle
from benchmarks.experiments import MAX_RATE
from benchmarks.flights import LIMITS, racing_lap

_AIR = {0.0: "without drag", 1.0: "with drag"}


def recovery_tables(rows: list) -> list[Table]:
    """Returns how the drones recover, a row for each drone and noise."""
    table = _table(
        f"Recovery from random attitudes and spins of up to {MAX_RATE:g} rad/s\n"
        "(bounds: hover within 3 s, 12 m of height; yaw is stopped later, see the last column)",
        "drone",
        "state noise",
        "hover within 3 s",
        "worst (s)",
        "mean (s)",
        "worst height lost (m)",
        "yaw stopped, worst (s)",
        f"rotors need for {MAX_RATE:g} rad/s (s)",
    )
    for (drone, noise), group in _grouped(rows, "drone", "noise"):
        times = [np.inf if row["hover_s"] is None else row["hover_s"] for row in group]
        yaw_times = [
            np.inf if row["yaw_stopped_s"] is None else row["yaw_stopped_s"] for row in group
        ]
        table.add_row(
            drone,
            noise,
            f"{np.sum(np.array(times) <= 3.0)}/{len(group)}",
            _number(max(times)),
            _number(np.mean(times)),
            _number(_worst(group, "height_lost_m")),
            _number(max(yaw_times)),
            _number(despin_time(load_vehicle(drone)[0], MAX_RATE), 1),
        )
    return [table]


def despin_time(vehicle: Vehicle, rate: float) -> float:
    """Returns how long the rotors need to stop a yaw rate in a hover, at least (s).

    Args:
        vehicle: the rotors.
        rate: (rad/s).
    """
    B = vehicle.allocation
    program = MathematicalProgram()
    thrusts = program.NewContinuousVariables(len(vehicle.rotors))
    program.AddBoundingBoxConstraint(np.zeros(len(thrusts)), vehicle.max_thrusts, thrusts)
    program.AddLinearEqualityConstraint(B[:3], [vehicle.mass * GRAVITY, 0.0, 0.0], thrusts)
    program.AddLinearCost(-B[3], 0.0, thrusts)
    return vehicle.inertia[2] * rate / -Solve(program).get_optimal_cost()


def tracking_tables(rows: list) -> list[Table]:
    """Returns how the drones track a lap, a row for each drone and case."""
    table = _table(
        f"Position error on the 3-D lap within {LIMITS['max_speed']:g} m/s and "
        f"{LIMITS['max_acceleration']:g} m/s^2, {racing_lap('Default').duration:.1f} s\n"
        "(bounds on the nominal RMS: 0.05 m, with noise 0.15 m; without feed-forward at "
        "least three times that)",
        "drone",
        "case",
        "RMS (m)",
        "x nominal",
        "max (m)",
        "noise: RMS (m)",
        "max (m)",
    )
    nominal = None
    for (drone, case), group in _grouped(rows, "drone", "case"):
        (_, perfect), (_, noisy) = _grouped(group, "noise")
        rms = _worst(perfect, "rms_m")
        nominal = rms if case == "nominal" else nominal
        seeds = f" (worst of {len(perfect)})" if len(perfect) > 1 else ""
        table.add_row(
            drone,
            case + seeds,
            _number(rms, 3),
            "-" if rms is None or nominal is None else _number(rms / nominal, 1),
            _number(_worst(perfect, "max_m"), 3),
            _number(_worst(noisy, "rms_m"), 3),
            _number(_worst(noisy, "max_m"), 3),
        )
    return [table]


def wind_tables(rows: list) -> list[Table]:
    """Returns how the drones race in the wind, a row for each."""
    table = _table(
        "Races from pixels in the shipped scenario Wind (bound on the offset: 1 m)",
        "drone",
        "finished",
        "laps",
        "collisions",
        "worst gate offset (m)",
        "mean lap (s)",
        "why not",
    )
    for row in rows:
        table.add_row(
            row["drone"],
            _yes(row["finished"]),
            _laps(row),
            str(row["collisions"]),
            _number(row["worst_offset_m"]),
            _number(row["mean_lap_s"]),
            row["dnf_reason"] or "",
        )
    return [table]


def loss_tables(rows: list) -> list[Table]:
    """Returns what becomes of drones that lose rotors, in four tables."""
    losses = [row for row in rows if "rotors" in row]
    flying = [row for row in losses if row["phase"] is not None and row["drone"] == "StarOne"]
    pairs = [row for row in losses if len(row["rotors"]) == 2]
    falling = [row for row in losses if row["drone"] == "Default"]
    races = [row for row in rows if "laps" in row]
    return [_single_table(flying), _pair_table(pairs), _descent_table(falling), _race_table(races)]


def _single_table(rows) -> Table:
    table = _table(
        "StarOne: one rotor lost, at four phases of the lap (worst of them)",
        "rotor",
        "found after (ms)",
        *(f"largest deviation (m), {air}" for air in _AIR.values()),
    )
    for (rotors,), group in _grouped(rows, "rotors"):
        table.add_row(
            str(rotors[0]),
            _number(1e3 * _worst(group, "found_after_s"), 0),
            *(_number(_worst(part, "deviation_m"), 3) for _, part in _grouped(group, "drag")),
        )
    return table


def _pair_table(rows) -> Table:
    table = _table(
        "StarOne: two rotors lost in a hover at 8 m",
        "rotors",
        "controllable",
        *(
            f"{what}, {air}"
            for air in _AIR.values()
            for what in ("largest deviation (m)", "touch-down (m/s)")
        ),
    )
    for (rotors,), group in _grouped(rows, "rotors"):
        cells = []
        for _, (row,) in _grouped(group, "drag"):
            touch_down = (
                None if row["sink_m_s"] is None else np.hypot(row["sink_m_s"], row["side_m_s"])
            )
            cells += [_number(row["deviation_m"]), _number(touch_down)]
        table.add_row(" and ".join(map(str, rotors)), _yes(group[0]["can_fly"]), *cells)
    return table


def _descent_table(rows) -> Table:
    table = _table(
        "Default: each of the four rotors lost, the way down\n"
        "(touch-down: of those that did not hit a pylon on the way)",
        "lost",
        "drag",
        "from (m)",
        "takes (s)",
        "hit a pylon",
        "worst sink at touch-down (m/s)",
        "mean",
        "worst to the side (m/s)",
        "worst tilt (deg)",
        "fastest sink of all (m/s)",
    )
    for (phase, drag), group in _grouped(rows, "phase", "drag"):
        down = [row for row in group if row["sink_m_s"] is not None]
        table.add_row(
            "in a hover" if phase is None else f"at {phase:.0%} of the lap",
            _yes(drag),
            _number(_worst(group, "height_m"), 1),
            _number(_worst(down, "descent_s"), 1),
            f"{len(group) - len(down)}/{len(group)}",
            _number(_worst(down, "sink_m_s")),
            _number(np.mean([row["sink_m_s"] for row in down]) if down else None),
            _number(_worst(down, "side_m_s")),
            _number(_worst(down, "tilt_deg"), 0),
            _number(_worst(group, "fastest_sink_m_s"), 1),
        )
    return table


def _race_table(rows) -> Table:
    table = _table(
        "StarOne: races from pixels in which a rotor is lost",
        "case",
        "finished",
        "laps",
        "mean lap before (s)",
        "mean lap after (s)",
        "worst gate offset (m)",
        "why not",
    )
    for row in rows:
        table.add_row(
            row["case"],
            _yes(row["finished"]),
            _laps(row),
            _number(row["mean_before_s"]),
            _number(row["mean_after_s"]),
            _number(row["worst_offset_m"]),
            row["dnf_reason"] or "",
        )
    return table


def _table(title, *columns) -> Table:
    table = Table(title=title)
    for i, name in enumerate(columns):
        table.add_column(name, justify="left" if i == 0 else "right")
    return table


def _grouped(rows, *keys) -> list:
    """Returns pairs of values of the keys and the rows with them, in order of appearance."""
    groups = {}
    for row in rows:
        groups.setdefault(str([row[key] for key in keys]), []).append(row)
    return [([group[0][key] for key in keys], group) for group in groups.values()]


def _worst(rows, key):
    """Returns the greatest number of rows, or None if one has none or there are no rows."""
    numbers = [row[key] for row in rows]
    return None if None in numbers else max(numbers, default=None)


def _number(x, digits=2) -> str:
    return "-" if x is None else "never" if np.isinf(x) else f"{x:.{digits}f}"


def _yes(x) -> str:
    return "yes" if x else "no"


def _laps(row) -> str:
    return f"{len(row['lap_times_s'])}/{row['laps']}"


TABLES = {
    "recovery": recovery_tables,
    "tracking": tracking_tables,
    "wind": wind_tables,
    "loss": loss_tables,
}
