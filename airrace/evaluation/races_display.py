"""Races on the terminal while they are flown: a bar, and a line for each that has ended."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from airrace.common.words import printable


class RacesDisplay(Progress):
    """Shows many races on standard error; inside its ``with`` block the bar is live."""

    def __init__(
        self, greeting: Sequence[str], ended: int, total: int, *columns: TextColumn, **fields: Any
    ):
        """Args: greeting: lines to begin with. columns, fields: of Progress, beside the usual."""
        super().__init__(
            TextColumn("Racing"),
            BarColumn(),
            MofNCompleteColumn(),
            *columns,
            TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(stderr=True),
        )
        self._greeting, self._ended, self._total = greeting, ended, total
        self._bar = self.add_task("", total=total, completed=ended, **fields)

    def __enter__(self) -> Self:
        for line in self._greeting:
            print_line(self.console, line)
        if self._ended:
            print_line(
                self.console, f"{self._ended} of {self._total} races have been flown already."
            )
        super().__enter__()
        return self

    def show_line(self, line: str, **fields: Any) -> None:
        """Shows that a race has ended, and how."""
        self._ended += 1
        self.update(self._bar, completed=self._ended, **fields)
        number = f"[{self._ended:{len(str(self._total))}}/{self._total}]"
        print_line(self.console, f"{number} {line}")


def print_line(console: Console, line: str) -> None:
    """Prints a line as it is: names and reasons may look like markup, and are not broken."""
    console.print(printable(line), highlight=False, markup=False, emoji=False, soft_wrap=True)


def say_if_stopped(stopped: str | None, flown: int, total: int, folder: Path) -> int:
    """Says why races were ended early, if they were; returns the exit code of the command."""
    if stopped is None:
        return 0
    print(
        f"airrace: {stopped}; {flown} of {total} races are in {folder}: the same command with "
        "--resume flies the others.",
        file=sys.stderr,
    )
    return 1
