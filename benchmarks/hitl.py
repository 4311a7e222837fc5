"""Lap times over bad links: python -m benchmarks.hitl.

Both sides of HITL in one process and in simulated time, on a link whose delay and
loss are declared: the same numbers on every machine.
"""

import argparse
import dataclasses as dc
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from airrace.common.errors import exit_code
from airrace.common.files import write_json
from airrace.diagrams.race import run_race
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.hitl.link.simulated_bus import LinkConfig
from airrace.scenario import LINK_DELAY, Scenario

DELAYS = (0.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # ms, there and back each half
LOSSES = (0.0, 0.5, 1.0, 2.0, 5.0)  # % of the packets


def fly(delay: float, loss: float, *, laps: int, track: str, trajectory: str, seed: int) -> dict:
    """Flies a race over a link and returns a row.

    Args:
        delay: there and back (ms). loss: of the packets (%).
        laps, track, trajectory, seed: of the race.
    """
    scenario = Scenario(
        track=track, laps=laps, trajectory=trajectory, seed=seed, link_delay=LINK_DELAY
    )
    link = LinkConfig(delay=delay / 2e3, jitter=delay / 8e3, loss=loss / 100, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        autonomy = Path(folder) / "autonomy"
        autonomy.mkdir()
        result = run_race(
            scenario, Path(folder), transport=SimulatedRemote(scenario, link, autonomy)
        )
    offsets = [max(lap["gate_offsets_m"]) for lap in result["laps"]]
    return {
        "link": dc.asdict(link),
        "delay_ms": delay,
        "loss_percent": loss,
        "finished": result["finished"],
        "dnf_reason": result["dnf_reason"],
        "mean_lap_s": result["mean_lap_s"],
        "worst_gate_offset_m": max(offsets, default=None),
        "exploration_s": result["exploration"]["time_s"],
        "map_rms_m": result["laps"][-1]["map_rms_m"] if result["laps"] else None,
        "watchdog": result["wall"]["link"]["watchdog"],
    }


def make_table(rows: list) -> Table:
    """Returns the table of the rows."""
    table = Table(title="HITL in simulated time")
    for heading in (
        "delay there and back (ms)",
        "loss (%)",
        "mean lap (s)",
        "worst gate offset (m)",
        "exploration (s)",
        "map RMS (cm)",
        "holds, hovers",
    ):
        table.add_column(heading, justify="right")
    for row in rows:
        found = ("-", "-", row["dnf_reason"], "-")
        if row["finished"]:
            found = (
                f"{row['mean_lap_s']:.2f}",
                f"{row['worst_gate_offset_m']:.2f}",
                f"{row['exploration_s']:.1f}",
                f"{100 * row['map_rms_m']:.1f}",
            )
        watchdog = row["watchdog"]
        table.add_row(
            f"{row['delay_ms']:g}",
            f"{row['loss_percent']:g}",
            *found,
            f"{watchdog['holds']}, {watchdog['hovers']}",
        )
    return table


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hitl",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--delays",
        type=float,
        nargs="+",
        default=DELAYS,
        metavar="MS",
        help="there and back, each with a quarter of jitter; without loss",
    )
    parser.add_argument(
        "--losses",
        type=float,
        nargs="+",
        default=LOSSES,
        metavar="PERCENT",
        help="of packets of 1472 bytes; without delay",
    )
    parser.add_argument("--laps", type=int, default=2)
    parser.add_argument("--track", default="student-airrace")
    parser.add_argument("-t", "--trajectory", default="optimal")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="the rows as JSON, too")
    args = parser.parse_args(argv)
    cases = [(delay, 0.0) for delay in args.delays] + [
        (0.0, loss) for loss in args.losses if loss > 0.0 or not args.delays
    ]

    def run():
        rows, console = [], Console(width=120)
        with Progress(console=console, transient=True) as progress:
            for delay, loss in progress.track(cases, description="races"):
                rows.append(
                    fly(
                        delay,
                        loss,
                        laps=args.laps,
                        track=args.track,
                        trajectory=args.trajectory,
                        seed=args.seed,
                    )
                )
        console.print(make_table(rows))
        if args.json is not None:
            write_json(args.json, rows)
        return 0

    return exit_code(run)


if __name__ == "__main__":
    sys.exit(main())
