"""A season on the terminal: a bar and a line a race, then the ranking."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

if TYPE_CHECKING:
    from airrace.league.season_run import Plan


class LeagueDisplay(Progress):
    """Shows a season; inside its ``with`` block the bar is live. It is on standard error."""

    def __init__(self, plan: "Plan", rows: list[dict]):
        """Args: plan: of the season. rows: of the races that were flown before."""
        super().__init__(
            TextColumn("Racing"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(stderr=True),
        )
        self._plan, self._ended, self._total = plan, len(rows), len(plan.flights)
        self._bar = self.add_task("", total=self._total, completed=self._ended)

    def __enter__(self) -> "LeagueDisplay":
        plan = self._plan
        print_line(
            self.console,
            f"airrace: {plan.season.name}: {len(plan.entries)} entries, "
            f"{len(plan.legs)} races each",
        )
        for name, reason in plan.refused.items():
            print_line(self.console, f"not accepted: {name}: {reason}")
        if self._ended:
            print_line(
                self.console, f"{self._ended} of {self._total} races have been flown already."
            )
        return super().__enter__()

    def show(self, row: dict) -> None:
        """Shows that a race has ended."""
        self._ended += 1
        self.update(self._bar, completed=self._ended)
        number = f"[{self._ended:{len(str(self._total))}}/{self._total}]"
        print_line(self.console, f"{number} race {row['leg']}, {row['entry']}: {words_of(row)}")


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
            teams[each["entry"]],
            each["entry"],
            f"{each['finished']} of {each['races']}",
            f"{100 * each['step']:.0f} %",
            *("–" if lap is None else f"{lap:.3f} s" for lap in laps),
        )
    with contextlib.suppress(OSError):  # nobody reads; the files are there
        console = Console()
        console.print(table)
        print_line(console, f"Results: {page}")


def print_line(console: Console, line: str) -> None:
    """Prints a line as it is: names and reasons may look like markup, and are not broken."""
    console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
