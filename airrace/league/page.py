"""league.html: the ranking, every race with its replay, how entries behaved; and its duels."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from airrace.analysis.page_templates import page_template
from airrace.common.files import write_text
from airrace.league.season_files import DUELS, PAGE, race_folder


class Column(NamedTuple):
    """A column of a table: its head, and what it says, for who points at it."""

    name: str
    meaning: str


RANKING = (
    Column("place", "By the columns step and mean lap."),
    Column("team", "And the entry's name."),
    Column("finished", "Races that it finished, of those that it flew."),
    Column("finish rate (%)", "With the interval in which it lies in 95 of 100 cases (Wilson)."),
    Column("step (%)", "The interval's lower end, rounded down to a step: the first that counts."),
    Column("mean lap (s)", "Over the races that all entries of its step finished: the second."),
    Column("best lap (s)", "The quickest of all. It does not count."),
    Column(
        "missed deadlines",
        "Steps of the link that took more processor time than allowed. They "
        "do not count, since they depend on the computer.",
    ),
    Column("attempts", "What entries tried that the sandbox refused; see below."),
)


def write_page(folder: Path, league: dict, duels: Sequence[dict] = ()) -> Path:
    """Writes league.html, which needs no network; returns its path.

    Args: league: what league.json holds. duels: of make_duels().

    Raises UserError if it cannot be written.
    """
    settings = league["settings"]
    order = [each["entry"] for each in league["ranking"]]  # the best first
    flights = {(line["entry"], line["leg"]): line for line in league["flights"]}
    text = page_template("airrace.league", PAGE).render(
        league=league,
        season=settings["season"],
        settings=settings,
        teams={entry["entry"]: entry for entry in settings["entries"]},
        columns=RANKING,
        standings=[_standing(each, league) for each in league["ranking"]],
        rows=[
            (leg, [_cell(folder, flights.get((name, leg["leg"]))) for name in order])
            for leg in league["legs"]
        ],
        order=order,
        failures=[line for line in league["flights"] if not line["finished"]],
        attempts=_attempts(league),
        duels=duels,
        duels_folder=DUELS,
    )
    path = folder / PAGE
    write_text(path, text)
    return path


def _standing(standing: dict, league: dict) -> dict[str, Any]:
    """Returns a line of the ranking, with what it does not count."""
    own = [line for line in league["flights"] if line["entry"] == standing["entry"]]
    conducts = [line["conduct"] for line in own]
    return standing | {
        "missed": sum(each.get("missed_deadlines", 0) for each in conducts),
        "longest_s": max((each.get("longest_step_s", 0.0) for each in conducts), default=0.0),
        "attempts": len({attempt for each in conducts for attempt in each["attempts"]}),
    }


def _cell(folder: Path, line: dict | None) -> dict[str, Any]:
    """Returns what the table of races says of one."""
    if line is None:
        return {"text": "–", "title": "not flown yet", "link": None, "failed": False}
    replay = f"{race_folder(line['entry'], line['leg'])}/race.html"
    text = f"{line['mean_lap_s']:.2f}" if line["finished"] else short_reason(line["dnf_reason"])
    return {
        "text": text,
        "title": line["dnf_reason"] or f"{line['laps']} laps, best {line['best_lap_s']:.2f} s",
        "link": replay if (folder / replay).exists() else None,
        "failed": not line["finished"],
    }


def short_reason(reason: str) -> str:
    """Returns the beginning of a reason, for a cell."""
    reason = reason.removeprefix("the entry was stopped by an error: ")
    return reason if len(reason) <= 34 else f"{reason[:32].rstrip()} …"


def _attempts(league: dict) -> list[tuple[str, str, list[int]]]:
    """Returns entry, what it tried, and in which races."""
    found: dict[tuple[str, str], list[int]] = {}
    for line in league["flights"]:
        for attempt in line["conduct"]["attempts"]:
            found.setdefault((line["entry"], attempt), []).append(line["leg"])
    return [(entry, attempt, legs) for (entry, attempt), legs in found.items()]


def make_duels(
    folder: Path, league: dict, show: Callable[[int], object] = lambda leg: None
) -> list:
    """Writes a page for each race that two entries have finished.

    Args:
        league: what league.json holds.
        show: called with the number of each race before its page is made.

    Returns dictionaries: ``leg``, ``link``, ``first`` and ``second`` (names of entries), ``gap_s``.

    Raises UserError if a page cannot be written.
    """
    from airrace.analysis.run import load_run
    from airrace.visualization.ghosts import make_ghosts, replay_page

    duels = []
    for leg in (line["leg"] for line in league["legs"]):
        pair = two_best(league, leg)
        if pair is None:
            continue
        runs = [folder / race_folder(line["entry"], leg) for line in pair]
        if not all((run / "race.mcap").exists() for run in runs):
            continue
        show(leg)
        page = folder / DUELS / f"{leg}.html"
        if not page.exists() or page.stat().st_mtime < max(r.stat().st_mtime for r in runs):
            page.parent.mkdir(exist_ok=True)
            ghosts = make_ghosts([load_run(run) for run in runs], align="lap")
            write_text(page, replay_page(ghosts, pictures=False))
        first, second = pair
        names = {"first": first["entry"], "second": second["entry"]}
        gap = second["mean_lap_s"] - first["mean_lap_s"]
        duels.append({"leg": leg, "link": f"{DUELS}/{leg}.html", **names, "gap_s": gap})
    return duels


def two_best(league: dict, leg: int) -> tuple[dict, dict] | None:
    """Returns the two races with the quickest mean laps of those finished on a track, or None."""
    done = [line for line in league["flights"] if line["leg"] == leg and line["finished"]]
    done.sort(key=lambda line: (line["mean_lap_s"], line["entry"]))
    return (done[0], done[1]) if len(done) > 1 else None
