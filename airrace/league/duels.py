"""Ghosts: of each race, the best entry against the second, on one page."""

from collections.abc import Callable
from pathlib import Path

from airrace.common.files import write_text
from airrace.league.season_files import DUELS, race_folder


def make_duels(
    folder: Path, league: dict, show: Callable[[int], object] = lambda leg: None
) -> list:
    """Writes a page for each race that two entries have finished.

    Args:
        league: what league.json holds.
        show: called with the number of each race before its page is made.

    Returns:
        dictionaries: ``leg``, ``link``, ``first`` and ``second`` (names of entries), ``gap_s``.

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
