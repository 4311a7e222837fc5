"""Holds the races of two checkouts against each other: python -m tools.compare_races A B.

Eight scenarios are flown in each, all of seed 5, the last one by the example of a MAVLink client.
race.json and map.json should be equal but for wall times; where they are not, the greatest
difference of a lap time is printed. Races from pixels amplify the last digit of anything: with
--rounding, the first checkout also flies with a start that is moved by 1e-12 m, and how much its
own laps change by that is printed beside.
"""

import argparse
import concurrent.futures
import json
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

ONE_ROTOR_LOST = "{rotor_failures: [{rotor: 3, time: 60.0}]}"
RACES = {
    "default": ["--laps", "2"],
    "four": ["--laps", "2", "-t", "4"],
    "star_one": ["--laps", "2", "-d", "StarOne", "--scenario_text", ONE_ROTOR_LOST],
    "level3": ["--laps", "2", "--level", "3"],
    "level4": ["--laps", "2", "--level", "4"],
    "vio": ["--laps", "2", "--estimator", "vio"],
    "learned": ["--laps", "2", "--policy", "learned"],
    "grand_prix": ["--step"],
}
QUIET = ["--seed", "5", "--no-meshcat", "--record", "none"]
CLIENT = Path("examples/grand_prix_client.py")


def fly(checkout: Path, name: str, folder: Path, options=()) -> None:
    """Flies a race of RACES with a checkout's own .venv, unless the folder has it already."""
    if (folder / "race.json").exists():
        return
    python, words = checkout.resolve() / ".venv/bin/python", [*QUIET, *RACES[name], *options]
    words += ["--output", str(folder.resolve())]
    if name == "grand_prix":
        done = fly_client(checkout, python, words)
    else:
        command = [python, "-m", "airrace.diagrams.race", "--no-report", *words]
        done = subprocess.run(command, cwd=checkout, capture_output=True, text=True)
    if not (folder / "race.json").exists():
        sys.exit(f"{checkout} could not fly {name}:\n{done.stderr}")


def fly_client(checkout: Path, python: Path, words: list[str]) -> subprocess.CompletedProcess:
    """Has a checkout's own client fly the Grand Prix in its simulation, in lockstep."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        a.bind(("127.0.0.1", 0))
        b.bind(("127.0.0.1", 0))
        mavlink, pictures = (str(each.getsockname()[1]) for each in (a, b))
    client = [python, CLIENT, "--mavlink", mavlink, "--pictures", pictures]
    with subprocess.Popen(client, cwd=checkout, stdout=subprocess.DEVNULL) as flying:
        ports = ["--client", f"127.0.0.1:{mavlink}", "--picture_port", pictures, "--linger", "0"]
        command = [python, "-m", "airrace", "grand-prix", *words, *ports]
        done = subprocess.run(command, cwd=checkout, capture_output=True, text=True)
        flying.kill()
    return done


def moved_track(checkout: Path, folder: Path) -> Path:
    """Returns a file of the track student-airrace whose start is moved by 1e-12 m."""
    text = (checkout / "models/tracks/student-airrace.yaml").read_text("utf-8")
    moved = text.replace("start: {position: [0.0,", "start: {position: [1.0e-12,")
    assert moved != text
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "moved.yaml").write_text(moved, "utf-8")
    return (folder / "moved.yaml").resolve()


def results(folder: Path) -> dict:
    """Returns what race.json and map.json of a race hold, but for wall times."""
    race = json.loads((folder / "race.json").read_text("utf-8"))
    race.pop("wall")
    found = folder / "map.json"  # a client keeps its map to itself
    text = found.read_text("utf-8") if found.exists() else "{}"
    return {"race.json": race, "map.json": json.loads(text)}


def differences(a, b, path="") -> list[str]:
    """Returns the places at which two structures of JSON differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        keys = sorted(a.keys() | b.keys())
        return [x for k in keys for x in differences(a.get(k), b.get(k), f"{path}/{k}")]
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return [x for i, both in enumerate(zip(a, b)) for x in differences(*both, f"{path}/{i}")]
    return [] if a == b else [f"{path}: {a} and {b}"]


def lap_difference(a: dict, b: dict) -> str:
    """Returns the greatest difference between the lap times of two races, as text."""
    races = [result["race.json"] for result in (a, b)]
    if "gate_times_s" in races[0]:
        times = [race["gate_times_s"] for race in races]
    else:
        times = [[lap["time_s"] for lap in race["laps"]] for race in races]
    if len(times[0]) != len(times[1]):
        return f"{len(times[0])} and {len(times[1])} laps or gates"
    return f"{max((abs(x - y) for x, y in zip(*times)), default=0.0):.1e} s"


def main() -> int:
    """The command-line program; returns 0 if all races are equal, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("checkouts", nargs=2, type=Path, help="before and after, each with .venv")
    parser.add_argument("--only", choices=RACES, nargs="+", default=list(RACES))
    parser.add_argument(
        "--output",
        type=Path,
        help="keeps the races in a/ and b/ there; what is there already is not flown again",
    )
    parser.add_argument("--rounding", action="store_true", help="fly with a moved start, too")
    parser.add_argument("--show", type=int, default=5, help="differences to print a race")
    args = parser.parse_args()
    output = args.output or Path(tempfile.mkdtemp())
    before, after = args.checkouts
    sides = {"a": (before, ()), "b": (after, ())}
    if args.rounding:
        sides["moved"] = before, ("--track", str(moved_track(before, output)))
    folders = {
        (side, name): output / side / name
        for name in args.only
        for side in sides
        if (side, name) != ("moved", "grand_prix")
    }
    with (
        Progress(console=Console(stderr=True)) as progress,
        concurrent.futures.ThreadPoolExecutor(2) as pool,
    ):
        flown = [
            pool.submit(fly, sides[s][0], name, folder, sides[s][1])
            for (s, name), folder in folders.items()
        ]
        for each in progress.track(concurrent.futures.as_completed(flown), total=len(flown)):
            each.result()
    table = Table("race", "race.json and map.json", "lap times differ by")
    if args.rounding:
        table.add_column("by 1e-12 m of the start")
    all_equal, shown = True, []
    for name in args.only:
        a, b = (results(folders[side, name]) for side in "ab")
        found = differences(a, b)
        all_equal &= not found
        row = [name, f"{len(found)} differences" if found else "equal", lap_difference(a, b)]
        if ("moved", name) in folders:
            row.append(lap_difference(a, results(folders["moved", name])))
        table.add_row(*row)
        shown += [f"{name}{each}" for each in found[: args.show]]
    Console().print(table)
    print(*shown, sep="\n")
    return 0 if all_equal else 1


if __name__ == "__main__":
    sys.exit(main())
