"""An evaluation on the terminal: a bar and a line a race, then the tables."""

import contextlib
from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from airrace.evaluation.summary import race_line
from airrace.evaluation.tables import finish_line, summary_tables, title


class EvaluationDisplay(Progress):
    """Shows an evaluation; inside its ``with`` block the bar is live.

    Progress goes to standard error, the tables to standard output.
    """

    def __init__(self, settings: dict, rows: list[dict]):
        """Args: settings: of the evaluation. rows: of the races that ended before."""
        super().__init__(
            TextColumn("Racing"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[finished]} finished"),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(stderr=True),
        )
        self._title, self._total = title(settings), settings["tracks"]
        self._ended, self._finished = len(rows), sum(row["result"]["finished"] for row in rows)
        counts = {"completed": self._ended, "finished": self._finished}
        self._bar = self.add_task("", total=self._total, **counts)

    def __enter__(self) -> "EvaluationDisplay":
        _print(self.console, f"airrace: {self._title}")
        if self._ended:
            _print(self.console, f"{self._ended} of {self._total} races have been flown already.")
        return super().__enter__()

    def show(self, row: dict) -> None:
        """Shows that a race has ended."""
        line = race_line(row)
        self._ended += 1
        self._finished += line["finished"]
        self.update(self._bar, completed=self._ended, finished=self._finished)
        number = f"[{self._ended:{len(str(self._total))}}/{self._total}]"
        _print(self.console, f"{number} seed {line['seed']}: {_words(line)}")

    def print_summary(self, evaluation: dict, folder: Path) -> None:
        """Prints the tables and where the results are."""
        console = Console()
        with contextlib.suppress(OSError):  # nobody reads; the files are there
            _print(console, self._title)
            console.print(Markdown(summary_tables(evaluation["summary"])))
            _print(console, finish_line(evaluation["summary"]))
            _print(console, f"Results: {folder}")


def _print(console, line):
    """Prints a line as it is: names and reasons may look like markup."""
    console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def _words(line: dict) -> str:
    explored = (
        f"explored in {line['exploration_s']:.1f} s"
        if line["explored"]
        else f"{line['gates_found']} gates found"
    )
    if line["finished"]:
        return f"finished, {explored}, mean lap {line['mean_lap_s']:.2f} s"
    return f"did not finish: {line['dnf_reason']} ({explored}, {len(line['lap_times_s'])} laps)"
