"""What delay and loss on the link of HITL do to a race.

    python -m benchmarks.hitl [--delays 0 20 100] [--losses 0 1] [--laps 2] [--json FILE]

Both sides of HITL in one process and in simulated time, on a link whose delay and
loss are declared: the same numbers on every machine.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from airrace.diagrams.race import run_race
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.hitl.link.simulated_bus import LinkConfig
from airrace.scenario import LINK_DELAY, TRAJECTORIES, Scenario
from benchmarks import harness

_DELAYS = (0.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # ms, there and back each half
_LOSSES = (0.0, 0.5, 1.0, 2.0, 5.0)  # % of the packets


def main(argv=None) -> int:
    """Flies the races and prints the table."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--delays",
        type=_not_negative,
        nargs="+",
        default=_DELAYS,
        metavar="MS",
        help="there and back, each with a quarter of jitter; without loss",
    )
    parser.add_argument(
        "--losses",
        type=_not_negative,
        nargs="+",
        default=_LOSSES,
        metavar="PERCENT",
        help="of packets of 1472 bytes; without delay",
    )
    parser.add_argument("--laps", type=harness.count, default=2)
    parser.add_argument("--track", default="student-airrace")
    parser.add_argument("-t", "--trajectory", choices=TRAJECTORIES, default="optimal")
    parser.add_argument("--seed", type=int, default=0)
    return harness.run(parser, argv, measure, show)


def _not_negative(text: str) -> float:
    number = float(text)
    if not number >= 0.0:
        raise argparse.ArgumentTypeError("it must not be negative")
    return number


def measure(args) -> list:
    """Returns a row for every link."""
    scenario = Scenario(
        track=args.track,
        laps=args.laps,
        trajectory=args.trajectory,
        seed=args.seed,
        link_delay=LINK_DELAY,
    )
    scenario.check()
    cases = [(delay, 0.0) for delay in args.delays]
    cases += [(0.0, loss) for loss in args.losses if loss > 0.0]
    return [fly(scenario, *case) for case in harness.progress(cases, "Racing")]


def fly(scenario: Scenario, delay: float, loss: float) -> dict:
    """Flies a race over a link and returns a row.

    Args:
        scenario: of the race.
        delay: there and back (ms).
        loss: of the packets (%).
    """
    link = LinkConfig(delay=delay / 2e3, jitter=delay / 8e3, loss=loss / 100, seed=scenario.seed)
    with tempfile.TemporaryDirectory() as folder:
        autonomy = Path(folder) / "autonomy"
        autonomy.mkdir()
        transport = SimulatedRemote(scenario, link, autonomy)
        result = run_race(scenario, Path(folder), transport=transport)
    offsets = [max(lap["gate_offsets_m"]) for lap in result["laps"]]
    return {
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


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows; a race that does not finish is a result, too."""
    columns = {
        "delay there and back (ms)": "{delay_ms:g}",
        "loss (%)": "{loss_percent:g}",
        "finished": "{finished}",
        "mean lap (s)": "{mean_lap_s:.2f}",
        "worst gate offset (m)": "{worst_gate_offset_m:.2f}",
        "exploration (s)": "{exploration_s:.1f}",
        "map RMS (m)": "{map_rms_m:.3f}",
        "holds, hovers": "{watchdog[holds]}, {watchdog[hovers]}",
        "why not": lambda row: row["dnf_reason"] or "",
    }
    return [harness.make_table("HITL in simulated time", rows, columns)], True


if __name__ == "__main__":
    sys.exit(main())
