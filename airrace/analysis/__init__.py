"""Looks at races that were flown: tables of every signal, and a report.

>>> from airrace.analysis import load_run
>>> run = load_run("runs/20260101T120000Z-student-airrace-Default-6d")
>>> run.tracking.groupby("lap").distance.max()
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from airrace.analysis.run import Run, load_run

__all__ = ["Run", "load_run"]


def __getattr__(name: str) -> Any:
    # Imported when it is asked for: pandas takes a second, and the command line waits for this.
    if name not in __all__:
        raise AttributeError(f"module 'airrace.analysis' has no attribute '{name}'")
    from airrace.analysis import run

    return getattr(run, name)
