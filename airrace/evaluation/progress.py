"""An evaluation on the terminal: a bar and a line a race, then the tables."""

import contextlib
from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown
from rich.progress import TextColumn

from airrace.evaluation.races_display import RacesDisplay, print_line
from airrace.evaluation.summary import race_line
from airrace.evaluation.tables import finish_line, summary_tables, title


class EvaluationDisplay(RacesDisplay):
    """Shows an evaluation: progress on standard error, the tables on standard output."""

    def __init__(self, settings: dict, rows: list[dict]):
        """Args: settings: of the evaluation. rows: of the races that ended before."""
        self._title, self._finished = title(settings), sum(r["result"]["finished"] for r in rows)
        super().__init__(
            [f"airrace: {self._title}"],
            len(rows),
            settings["tracks"],
            TextColumn("{task.fields[finished]} finished"),
            finished=self._finished,
        )

    def show(self, row: dict) -> None:
        """Shows that a race has ended."""
        line = race_line(row)
        self._finished += line["finished"]
        self.show_line(f"seed {line['seed']}: {_words(line)}", finished=self._finished)

    def print_summary(self, evaluation: dict, folder: Path) -> None:
        """Prints the tables and where the results are."""
        console = Console()
        with contextlib.suppress(OSError):  # nobody reads; the files are there
            print_line(console, self._title)
            console.print(Markdown(summary_tables(evaluation["summary"])))
            print_line(console, finish_line(evaluation["summary"]))
            print_line(console, f"Results: {folder}")


def _words(line: dict) -> str:
    explored = (
        f"explored in {line['exploration_s']:.1f} s"
        if line["explored"]
        else f"{line['gates_found']} gates found"
    )
    if line["finished"]:
        return f"finished, {explored}, mean lap {line['mean_lap_s']:.2f} s"
    return f"did not finish: {line['dnf_reason']} ({explored}, {len(line['lap_times_s'])} laps)"
