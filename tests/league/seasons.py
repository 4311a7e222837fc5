"""The folder of a season that nobody flew."""

import json

from airrace.common.files import write_json
from airrace.evaluation.versions import versions
from airrace.league.entry import load_entry
from airrace.league.league_json import with_digests
from airrace.league.season import Season, make_legs
from airrace.league.season_files import (
    flight_lines,
    keep_files,
    keep_sources,
    make_league,
    settings,
    write_league,
)
from airrace.league.worker import result_digest
from tests.league.entries import make_entry

SECRET = "nobody can guess this"
SEASON = Season(
    name="Spring <b>", tracks=2, levels=[1], laps=1, track="hexagon", seed_file="spring.seed"
)
_TEXT = (
    "name: Spring <b>\ntracks: 2\nlevels: [1]\nlaps: 1\ntrack: hexagon\nseed_file: spring.seed\n"
)


def result(laps=(10.0,), reason=None):
    """The part of race.json that a league looks at."""
    return {
        "finished": reason is None,
        "dnf_reason": reason,
        "laps": [{"lap": i, "time_s": time} for i, time in enumerate(laps, 1)],
        "mean_lap_s": sum(laps) / len(laps) if laps else None,
        "best_lap_s": min(laps, default=None),
        "collisions": 0,
    }


def row(entry, leg, result, **conduct):
    """A row as fly() returns it."""
    return {
        "key": f"{entry}-{leg}",
        "entry": entry,
        "leg": leg,
        "result": result,
        "sha256": result_digest(result),
        "conduct": {"attempts": [], **conduct},
        "wall": None,
        "stderr": None,
        "files": {"entry.log": b""},
    }


def make_season(folder, results):
    """Writes what `airrace league run` leaves, but for the page and replays.

    Args:
        folder: a new one; beside it are the entries and the season's file and seed.
        results: names of entries to their results, one of each race.

    Returns:
        what league.json holds.
    """
    beside, folder_of = folder.parent, {}
    (beside / "spring.yaml").write_text(_TEXT)
    (beside / "spring.seed").write_text(SECRET)
    for name in results:
        folder_of[name] = make_entry(beside / name, f"team: Team {name}\n", mine=f"# {name}\n")
    folder.mkdir()
    entries = [load_entry(path) for path in folder_of.values()]
    keep_sources(folder, beside / "spring.yaml", entries)
    rows = []
    for name, each in results.items():
        for leg, one in enumerate(each, 1):
            made = one if "result" in one else row(name, leg, one)
            rows.append(keep_files(folder, made))
            path = folder / "races" / f"{name}-{leg}" / "race.json"
            write_json(path, {**made["result"], "wall": {"seconds": 3.0}})
    (folder / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    flown = {"versions": versions({}), "safe": True}
    told = settings(SEASON, SECRET, entries, {}, flown)
    write_league(folder, make_league(told, make_legs(SEASON, SECRET), flight_lines(rows)))
    return json.loads((folder / "league.json").read_text())


def seal(folder):
    """Gives league.json the hashes of what is in a season's folder now, as a forger does."""
    league = json.loads((folder / "league.json").read_text())
    rest = {name: value for name, value in league.items() if name not in ("files", "sha256")}
    write_json(folder / "league.json", with_digests(rest, folder, "league.json"))


def forge(path, change):
    """Rewrites a JSON file: ``change`` is called with what it holds."""
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
