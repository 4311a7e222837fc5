"""Looks at races that were flown: tables of every signal, and a report.

>>> from airrace.analysis import load_run
>>> run = load_run("runs/20260101T120000Z-student-airrace-Default-6d")
>>> run.tracking.groupby("lap").distance.max()
"""

from airrace.analysis.run import Run, load_run

__all__ = ["Run", "load_run"]
