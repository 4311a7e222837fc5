"""The set-up of a companion computer on the terminal: a line a step, and a bar."""

import contextlib

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)


class SetUpDisplay(contextlib.AbstractContextManager):
    """Shows a set-up on standard error; inside its ``with`` block the bar is live.

    The bar vanishes at the end. Where there is no terminal, each step is a line.
    """

    def __init__(self, host: str, console: Console | None = None):
        """Args: host: what to call the companion. console: standard error by default."""
        console = console or Console(stderr=True)
        self._host = host
        self._plain = None if console.is_terminal else console
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=None)

    def __enter__(self):
        self._progress.start()
        return self

    def __exit__(self, *_):
        self._progress.stop()

    def step(self, text: str) -> None:
        """Shows what is being done from now on."""
        if self._plain is not None:
            self._plain.print(
                f"airrace: {self._host}: {text}",
                highlight=False,
                markup=False,
                emoji=False,
                soft_wrap=True,
            )
        self._progress.reset(self._task, description=f"{self._host}: {text}", total=None)

    def progress(self, done: int, total: int) -> None:
        """Shows how far the step is."""
        self._progress.update(self._task, completed=done, total=total)
