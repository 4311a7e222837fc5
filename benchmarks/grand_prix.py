"""Holds `airrace grand-prix` to what its documentation promises, over UDP on this computer.

    python -m benchmarks.grand_prix [--only rates soak ...] [--json FILE]

rates       how often each message comes, of simulated time, beside docs/grand_prix.md
soak        minutes with pictures: what got lost on the way, and whether memory grows
malformed   20,000 bad datagrams around a good client: the race must be the same to the last bit
courses     a client on generated courses, nearly straight and winding: whether it finishes
threads     250 commands a second from three threads that count alike, in real time: what is dropped
flood       20,000 set-points a second: whether the time goes on
reset       a hundred resets in a row: whether memory grows
mavsdk      whether MAVSDK connects, reads the IMU, arms, takes off, flies a square and lands

The client hovers, but for courses, where --client names a program that is started with
--mavlink PORT --pictures PORT. Where time is simulated step by step, the figures are the same on
every machine; a soak in real time needs one without other work.
"""

import argparse
import sys
from pathlib import Path

from airrace.common.interrupts import sigterm_as_ctrl_c
from benchmarks import grand_prix_parts as parts
from benchmarks import grand_prix_threads, harness
from benchmarks.peers import environments as env

_RATE_ERROR = 0.02  # of the promised rate, at most
_GROWTH = 10.0  # MB, by which memory may grow between the first minute and the last
_GROWTH_PER_RESET = 0.1  # MB
_FLOODED = 0.3  # simulated seconds in one of the simulator's processor time, in a flood
_UNREAD = 62  # commands that may come after the race has ended
_PARTS = {
    "rates": parts.rates,
    "soak": parts.soak,
    "malformed": parts.malformed,
    "courses": parts.courses,
    "threads": grand_prix_threads.threads,
    "flood": grand_prix_threads.flood,
    "reset": parts.reset,
    "mavsdk": parts.mavsdk,
}


def main(argv=None) -> int:
    """Runs the parts and prints their tables; exit code 1 if a promise is broken."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--only", nargs="+", choices=_PARTS, default=list(_PARTS), help="(default: all)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of noise and courses (default: 0)")
    parser.add_argument(
        "--record", choices=("none", "light", "full"), default="full", help="in soak and reset"
    )
    parser.add_argument(
        "--rate_seconds", type=float, default=30.0, help="simulated, of rates (default: 30)"
    )
    soak = parser.add_argument_group("soak")
    soak.add_argument("--seconds", type=harness.count, default=600, help="(default: 600)")
    soak.add_argument("--realtime_rate", type=float, default=1.0, help="(default: 1)")
    soak.add_argument("--step", action="store_true", help="in the place of real time")
    noise = parser.add_argument_group("malformed")
    noise.add_argument("--datagrams", type=harness.count, default=20000, help="(default: 20000)")
    noise.add_argument("--noise_seconds", type=float, default=25.0, help="simulated (default: 25)")
    courses = parser.add_argument_group("courses")
    courses.add_argument("--tracks", type=harness.count, default=20, help="(default: 20)")
    courses.add_argument(
        "--client",
        type=Path,
        default=parts.ROOT / "examples" / "grand_prix_client.py",
        help="program that flies (default: examples/grand_prix_client.py)",
    )
    courses.add_argument(
        "--vq", type=int, nargs="+", choices=(1, 2), default=[1, 2], help="(default: both)"
    )
    courses.add_argument("--quirks", default="official", help="(default: official)")
    courses.add_argument("--time_limit", type=float, default=480.0, help="s (default: 480)")
    pace = courses.add_mutually_exclusive_group()
    pace.add_argument(
        "--courses_rate", type=float, help="realtime rate (default: in steps, with --step)"
    )
    pace.add_argument(
        "--twice", action="store_true", help="fly each twice: both must be the same, in steps"
    )
    much = parser.add_argument_group("threads and flood")
    much.add_argument("--thread_seconds", type=float, default=20.0, help="(default: 20)")
    resets = parser.add_argument_group("reset")
    resets.add_argument("--resets", type=harness.count, default=100, help="(default: 100)")
    sdk = parser.add_argument_group("mavsdk")
    sdk.add_argument("--install", action="store_true", help="install MAVSDK if need be")
    env.add_folder(sdk)
    return harness.run(parser, argv, measure, show)


def measure(args: argparse.Namespace) -> dict:
    """Returns what each part measured; of one that could not be measured, why."""
    results: dict = {}
    with sigterm_as_ctrl_c():  # no simulator is left behind
        for name in args.only:
            try:
                results[name] = _PARTS[name](args)
            except env.PeerError as e:
                results[name] = {"failure": str(e)}
    return results


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables, and whether all promises are kept."""
    tables, passed = [], True
    for name, result in results.items():
        if "failure" in result:
            tables.append(f"{name}: {result['failure']}.")
            passed = False
            continue
        more, kept = _SHOW[name](result)
        tables += more
        passed = passed and kept
        if not kept:
            tables.append(f"{name}: a promise is broken.")
    return tables, passed


def show_rates(rows):
    """Returns the table of the rates, and whether they are those of the docs."""
    for row in rows:
        row["off"] = row["rate"] / row["promised"] - 1.0
    columns = {
        "message": "{kind}",
        "promised (Hz)": "{promised:g}",
        "measured (Hz)": "{rate:.2f}",
        "off (%)": lambda row: f"{100 * row['off']:+.2f}",
        "messages": "{count}",
    }
    title = "Rates, in simulated time (to be within 2 %)"
    kept = all(abs(row["off"]) <= _RATE_ERROR for row in rows)  # False of NaN
    return [harness.make_table(title, rows, columns)], bool(rows) and kept


def show_soak(result):
    """Returns the table of a soak, and whether nothing was lost and memory did not grow."""
    (sent, heard, gaps), (out, came) = result["messages"], result["picture_datagrams"]
    whole, missing, broken = result["pictures"]
    told, read = result["commands"]
    early, late = result["rss_mb"]
    figures = {
        "simulated (s)": result["simulated_s"],
        "pace; speed, x real time": f"{result['pace']}; {result['speed']:.2f}",
        "MAVLink messages sent, heard": f"{sent}, {heard}",
        "missing by their numbers": gaps,
        "datagrams of pictures sent, heard": f"{out}, {came}",
        "pictures whole, missing, broken": f"{whole}, {missing}, {broken}",
        "client's messages sent, read before the end": f"{told}, {read}",
        "steps without an answer": result["unanswered"],
        "memory after a minute, at the end (MB)": f"{early:.1f}, {late:.1f}",
        f"recorded, {result['record']} (MB)": result["recorded_mb"],
    }
    lossless = sent == heard and out == came and not (gaps or missing or broken)
    kept = lossless and 0 <= told - read <= _UNREAD and not late - early > _GROWTH
    figures["how it ended"] = result["end"]
    return [harness.make_list("Minutes with pictures", figures)], kept


def show_malformed(result):
    """Returns the table of the noise, and whether it did nothing but count."""
    rows = [
        {"kind": kind, "sent": sent, "by": " or ".join(parts.KINDS[kind]) or "nobody reads it"}
        for kind, sent in result["noise"].items()
    ]
    columns = {"datagrams": "{kind}", "sent": "{sent}", "counted as": "{by}"}
    title = f"{result['datagrams']} bad datagrams around a client in steps"
    same = {name: result[f"same_{name}"] for name in ("race", "messages", "pictures")}
    figures = {f"counted as {name}": count for name, count in result["counts"].items()}
    figures["all were counted"] = "yes" if result["counted"] else "no"
    figures["steps without an answer"] = result["unanswered"]
    for name, equal in same.items():
        figures[f"{name}: the same to the last bit as without them"] = "yes" if equal else "no"
    kept = all(same.values()) and result["counted"] and not result["unanswered"]
    beside = harness.make_list("The race beside them", figures)
    return [harness.make_table(title, rows, columns), beside], kept


def show_courses(rows):
    """Returns the table of the courses, and whether those flown twice were the same.

    One that is not finished is a result, too.
    """
    columns = {
        "VQ": "{vq}",
        "seed": "{seed}",
        "finished": "{finished}",
        "gates": "{gates_passed} of {gates}",
        "time (s)": "{time_s:.2f}",
        "top speed (m/s)": "{max_speed:.1f}",
        "contacts": "{collisions}",
        "wall (s)": "{wall_s:.0f}",
        "unanswered": "{unanswered}",
        "twice the same": "{same}",
        "why not": lambda row: row["client"] or row["dnf_reason"] or "",
    }
    counts = []
    for vq in sorted({row["vq"] for row in rows}):
        of_it = [row["finished"] for row in rows if row["vq"] == vq]
        counts.append(f"VQ{vq} {sum(of_it)} of {len(of_it)}")
    title = f"Generated courses: finished {', '.join(counts)}"
    kept = all(row["same"] in (None, True) for row in rows)
    return [harness.make_table(title, rows, columns)], kept


def show_threads(result):
    """Returns the list of what became of commands, and whether none was dropped."""
    figures = _link_figures(result)
    if result["delay_ms"] is not None:
        half, most = result["delay_ms"]
        figures["command to motors and back, median, p99 (ms)"] = f"{half:.1f}, {most:.1f}"
    kept = result["dropped"] == 0 and result["received"] > 0.99 * result["sent"]
    return [harness.make_list("Three threads, in real time", figures)], kept


def show_flood(result):
    """Returns the list of what became of a flood, and whether the time has gone on."""
    figures = _link_figures(result)
    return [harness.make_list("A flood", figures)], result["simulated_per_cpu_s"] > _FLOODED


def _link_figures(result):
    return {
        "seconds": result["seconds"],
        "messages sent, received, dropped": "{sent}, {received}, {dropped}".format(**result),
        "simulated seconds in a second of processor time": f"{result['simulated_per_cpu_s']:.2f}",
    }


def show_reset(rows):
    """Returns the table of the memory, and whether it does not grow with each reset."""
    for before, row in zip([None, *rows], rows):
        between = row["resets"] - before["resets"] if before else 0
        row["each"] = (row["rss_mb"] - before["rss_mb"]) / between if between else None
    columns = {
        "resets": "{resets}",
        "memory (MB)": "{rss_mb:.1f}",
        "growth by a reset (MB)": "{each:.3f}",
    }
    # The first ones also have costs of the first time.
    late = [row for row in rows if row["resets"] > 10]
    kept = all(row["each"] <= _GROWTH_PER_RESET for row in late)
    return [harness.make_table("Resets in a row", rows, columns)], kept


def show_mavsdk(result):
    """Returns the list of the steps, and whether it connected, read the IMU, armed and climbed."""
    steps = result["steps"]
    figures = {name: str(value) for name, value in steps.items()}
    figures["the race has started"] = "yes" if result["started"] else "no"
    kept = steps["connects"] and steps.get("imu_in_10_s", False) and result["started"]
    kept = kept and steps["climbed_m"] > 1.0 and steps["square_m"] < 0.5 and steps["landed"]
    return [harness.make_list("MAVSDK as it is", figures)], kept


_SHOW = {
    "rates": show_rates,
    "soak": show_soak,
    "malformed": show_malformed,
    "courses": show_courses,
    "threads": show_threads,
    "flood": show_flood,
    "reset": show_reset,
    "mavsdk": show_mavsdk,
}


if __name__ == "__main__":
    sys.exit(main())
