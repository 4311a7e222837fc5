"""A season on the terminal: a bar and a line a race, then the ranking."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from airrace.evaluation.races_display import RacesDisplay, print_line

if TYPE_CHECKING:
    from airrace.league.season_run import Plan


class LeagueDisplay(RacesDisplay):
    """Shows a season."""

    def __init__(self, plan: "Plan", rows: list[dict]):
        """Args: plan: of the season. rows: of the races that were flown before."""
        entries, legs = len(plan.entries), len(plan.legs)
        super().__init__(
            [
                f"airrace: {plan.season.name}: {entries} entries, {legs} races each",
                *(f"not accepted: {name}: {reason}" for name, reason in plan.refused.items()),
            ],
            len(rows),
            len(plan.flights),
        )

    def show(self, row: dict) -> None:
        """Shows that a race has ended."""
        self.show_line(f"race {row['leg']}, {row['entry']}: {words_of(row)}")


def words_of(row: dict) -> str:
    """Returns how a race ended; row: of worker.fly()."""
    result, conduct = row["result"], row["conduct"]
    if result["finished"]:
        text = f"finished, mean lap {result['mean_lap_s']:.3f} s"
    else:
        text = f"did not finish: {result['dnf_reason']}"
    if missed := conduct.get("missed_deadlines", 0):
        text += f"; {missed} missed deadlines"
    if conduct["attempts"]:
        text += f"; tried: {', '.join(conduct['attempts'][:3])}"
    return text


def print_ranking(league: dict, page: Path) -> None:
    """Prints the ranking, and where the page is."""
    table = Table("", "team", "entry", "finished", "step", "mean lap", "best lap")
    for name in ("finished", "step", "mean lap", "best lap"):
        next(c for c in table.columns if c.header == name).justify = "right"
    teams = {line["entry"]: line["team"] for line in league["settings"]["entries"]}
    for each in league["ranking"]:
        laps = [each["mean_lap_s"], each["best_lap_s"]]
        table.add_row(
            str(each["place"]),
            Text(teams[each["entry"]]),  # not as markup
            Text(each["entry"]),
            f"{each['finished']} of {each['races']}",
            f"{100 * each['step']:.0f} %",
            *("–" if lap is None else f"{lap:.3f} s" for lap in laps),
        )
    with contextlib.suppress(OSError):  # nobody reads; the files are there
        console = Console()
        console.print(table)
        print_line(console, f"Results: {page}")
