"""The tables of benchmarks/trajectories.py, each from rows of one of its functions."""

import numpy as np
from rich.table import Table

# What laps are meant to keep.
MOST_LAP = {3: 22.5, 4: 23.0, 6: 32.0}  # s, minimum snap, by dimensions
MOST_TIME, MOST_WARM_TIME = 5.0, 0.5  # s, cold and from another lap
MOST_WARM_GAP = 0.02  # of the converged lap time
MEDIAN_GAP, WORST_GAP = 0.02, 0.04  # over the bound, of generated tracks
MOVED = 0.3  # m, RMS


def bounds_table(rows) -> Table:
    """Returns the table of bound()."""
    table = _table(
        "Lap of a point mass on the reference track (bound: 0.3 % off what is published)",
        "limits",
        "midpoints (s)",
        "published",
        "windows (s)",
        "published",
        "iterations",
        "time (s)",
    )
    for row in rows:
        a, b = row["midpoints"], row["windows"]
        table.add_row(
            row["limits"],
            f"{a['duration_s']:.3f}",
            f"{a['published_s']:.2f}",
            f"{b['duration_s']:.3f}",
            f"{b['published_s']:.2f}",
            f"{a['iterations']}, {b['iterations']}",
            f"{a['cpu_s']:.2f}, {b['cpu_s']:.2f}",
        )
    return table


def min_snap_table(rows) -> Table:
    """Returns the table of min_snap()."""
    table = _table(
        "Minimum-snap laps of the reference track, through the midpoints within "
        "20 m/s and 10 m/s^2 (bounds: 22.5, 23, 32 s)",
        "dimensions",
        "lap (s)",
        "over the bound",
        "solved (ms)",
        "time (s)",
        "from itself (s)",
    )
    for row in rows:
        table.add_row(
            str(row["dimensions"]),
            f"{row['duration_s']:.2f}",
            f"{row['gap']:.1%}",
            f"{1000 * row['solve_cpu_s']:.1f}",
            f"{row['cpu_s']:.2f}",
            f"{row['warm_cpu_s']:.2f}",
        )
    return table


def optimal_table(rows) -> Table:
    """Returns the table of optimal() on the reference track."""
    table = _table(
        "Time-optimal laps of the reference track, balls of 0.4 m or windows of 3.2 by 2.5 m to "
        f"each side\n(bounds: {MOST_TIME:g} s to plan; original: balls 21.0 s, windows 19.3 s; "
        "rotor windows: Default 10.0 s; rotors within their limits by 0.5 %)",
        "drone",
        "limits",
        "gates",
        "lap (s)",
        "bound (s)",
        "over",
        "steps",
        "time (s)",
        "speed (m/s)",
        "accel. (m/s^2)",
        "rates (rad/s)",
        "rotors",
        "gate off axis (deg)",
    )
    for row in rows:
        if "fault" in row:
            table.add_row(row["drone"], row["limits"], row["gates"], row["fault"])
            continue
        table.add_row(
            row["drone"],
            row["limits"],
            row["gates"],
            f"{row['duration_s']:.2f}",
            f"{row['bound_s']:.2f}",
            f"{row['gap']:.2%}",
            str(row["iterations"]),
            f"{row['cpu_s']:.2f}",
            f"{row['max_speed']:.1f}",
            f"{row['max_acceleration']:.1f}",
            f"{row['max_rate']:.1f}",
            f"{row['least_share']:.1%} .. {row['most_share']:.1%}",
            f"{row['bearing_deg']:.1f}",
        )
    return table


def warm_table(rows) -> Table:
    """Returns the table of warm()."""
    table = _table(
        f"Gates moved by {MOVED} m RMS, planned from the lap before "
        f"(bounds: {MOST_WARM_GAP:.0%} of the converged lap in {MOST_WARM_TIME:g} s)",
        "drone",
        "limits",
        "laps",
        "over converged, mean",
        "worst",
        "steps",
        "time, mean (s)",
        "worst",
    )
    for (drone, limits), group in _grouped(rows, "drone", "limits"):
        gaps, cpu = ([row[k] for row in group] for k in ("gap", "cpu_s"))
        table.add_row(
            drone,
            limits,
            str(len(group)),
            f"{np.mean(gaps):.2%}",
            f"{max(gaps):.2%}",
            f"{np.mean([row['steps'] for row in group]):.1f}",
            f"{np.mean(cpu):.2f}",
            f"{max(cpu):.2f}",
        )
    return table


def generated_table(rows) -> Table:
    """Returns the table of optimal() on generated tracks."""
    table = _table(
        "Time-optimal laps of generated tracks (bounds: over a point mass that keeps "
        f"clear of the pylons, too, by {MEDIAN_GAP:.0%} in the median, {WORST_GAP:.0%} "
        "at worst)",
        "drone",
        "limits",
        "planned",
        "over, median",
        "worst",
        "time, mean (s)",
        "worst",
        "rotors",
        "gate off axis, worst (deg)",
    )
    for (drone, limits), group in _grouped(rows, "drone", "limits"):
        made = [row for row in group if "fault" not in row]
        gaps, cpu = ([row[k] for row in made] for k in ("gap", "cpu_s"))
        table.add_row(
            drone,
            limits,
            f"{len(made)}/{len(group)}",
            f"{np.median(gaps):.2%}",
            f"{max(gaps):.2%}",
            f"{np.mean(cpu):.2f}",
            f"{max(cpu):.2f}",
            f"{min(r['least_share'] for r in made):.1%} .. "
            f"{max(r['most_share'] for r in made):.1%}",
            f"{max(r['bearing_deg'] for r in made):.1f}",
        )
    return table


def _table(title, *columns) -> Table:
    table = Table(title=title)
    for name in columns:
        table.add_column(name, justify="right")
    return table


def _grouped(rows, *keys):
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row[k] for k in keys), []).append(row)
    return groups.items()
