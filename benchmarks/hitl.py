"""What delay and loss on the link of HITL do to a race.

    python -m benchmarks.hitl [--delays 0 20 100] [--losses 0 1] [--laps 2] [--json FILE]

Both sides of HITL in one process and in simulated time, on a link whose delay and
loss are declared: the same numbers on every machine.

    python -m benchmarks.hitl --ticks [--track hexagon] [--laps 1] [--realtime_rate 1]
        [--link_key FILE]

A race in real time on this computer, in processes as people race: how long each tick of
the pilot and of the navigator takes, as a histogram. What else runs here counts, too,
on the wall's clock; the processor's time is the ticks' own.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.autonomy_process import PILOT_TICKS
from airrace.hitl.link.simulated_bus import LinkConfig
from airrace.hitl.navigator_process import NAVIGATOR_TICKS
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.scenario import LINK_DELAY, TRAJECTORIES, Scenario
from benchmarks import harness
from benchmarks.whole_race import fly_race

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
    parser.add_argument("--ticks", action="store_true", help="race in real time, see above")
    parser.add_argument(
        "--realtime_rate", type=float, default=1.0, help="of --ticks (default: %(default)s)"
    )
    parser.add_argument("--link_key", type=Path, metavar="FILE", help="of --ticks")
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
    """Returns a row for every link, or for every loop."""
    if args.ticks:
        return time_ticks(args)
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
        result = fly_race(scenario, Path(folder), transport=transport)
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


def time_ticks(args) -> list:
    """Races in real time and returns a row for both clocks of pilot and navigator."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "race"
        race = [sys.executable, "-m", "airrace", "race", "-s", "HITL", "--no-meshcat"]
        race += ["--track", args.track, "--laps", args.laps, "-t", args.trajectory]
        race += ["--realtime_rate", args.realtime_rate, "--seed", args.seed, "--output", output]
        race += ["--link_key", args.link_key] if args.link_key else []
        done = subprocess.run([*map(str, race), "--no-report"], capture_output=True, text=True)
        files = {
            loop: output / "autonomy" / name
            for loop, name in (("pilot", PILOT_TICKS), ("navigator", NAVIGATOR_TICKS))
        }
        if done.returncode > 1 or not all(path.exists() for path in files.values()):
            raise UserError(f"The race could not be flown: {done.stdout[-300:]}{done.stderr}")
        result = json.loads((output / "race.json").read_text())
        return [
            {
                "loop": loop,
                "clock": clock,
                "finished": result["finished"],
                "dnf_reason": result["dnf_reason"],
                "mean_lap_s": result["mean_lap_s"],
                **times,
            }
            for loop, path in files.items()
            for clock, times in json.loads(path.read_text()).items()
        ]


def show_ticks(rows: list) -> list:
    """Returns the table of the loops, and the histogram of each by the wall's clock."""
    first = rows[0]
    end = f"finished, {first['mean_lap_s']:.2f} s a lap" if first["finished"] else "did not finish"
    columns = {
        "loop": "{loop}",
        "clock": "{clock}",
        "ticks": "{count}",
        "median (ms)": lambda row: f"{1e3 * row['median_s']:.2f}",
        "p99 (ms)": lambda row: f"{1e3 * row['p99_s']:.2f}",
        "p99.9 (ms)": lambda row: f"{1e3 * row['p99_9_s']:.2f}",
        "worst (ms)": lambda row: f"{1e3 * row['worst_s']:.1f}",
    }
    tables = [harness.make_table(f"Ticks of a race in real time, which {end}", rows, columns)]
    for row in rows:
        edges = [(low, 2 * low) for low in (1e-4 * 2.0**k for k in range(-3, 14))]
        bins = [
            {
                "range": f"{1e3 * low:g} to {1e3 * high:g}",
                "share": sum(n for edge, n in row["histogram"] if low < edge <= high),
                "of": row["count"],
            }
            for low, high in edges
        ]
        columns = {
            "time (ms)": "{range}",
            "ticks": "{share}",
            "%": lambda each: f"{100 * each['share'] / each['of']:.3f}",
        }
        title = f"{row['loop']}, {row['clock']}"
        tables.append(harness.make_table(title, [b for b in bins if b["share"]], columns))
    return tables


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows; a race that does not finish is a result, too."""
    if "loop" in rows[0]:
        return show_ticks(rows), True
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
