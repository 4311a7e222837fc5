"""What all benchmarks share: the command line, processes with one thread each, and tables.

A benchmark has two functions. One measures and returns plain data, with NaN for what there
is not and infinity for what never happened; the other makes tables of that.
"""

import argparse
import contextlib
import datetime
import math
import multiprocessing
import os
import platform
import re
import string
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from airrace.common.errors import UserError, exit_code
from airrace.common.files import write_json
from airrace.common.processes import ONE_THREAD

_LOOK = 1.0  # s, between two looks at whether another process is there

_WIDTH = 160  # characters


def make_parser(doc: str, *, runs: int | None = None) -> argparse.ArgumentParser:
    """Returns a parser with --json, and with --runs if a default for that is given.

    Args:
        doc: of the benchmark's module.
        runs: the default of --runs.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all figures there")
    if runs is not None:
        parser.add_argument(
            "--runs", type=count, default=runs, help="medians of so many (default: %(default)s)"
        )
    return parser


def count(text: str) -> int:
    """Returns the number of an option, which must be at least 1."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("it must be at least 1")
    return number


def run(parser, argv, measure, show) -> int:
    """Runs a benchmark and prints its tables.

    Args:
        parser: of make_parser().
        argv: options; None for those of the command line.
        measure: parsed options to results.
        show: results to a list of tables and lines, and whether all bounds are kept.

    Returns:
        the exit code: 0, 1 if a bound is broken, 2 for bad input.
    """
    args = parser.parse_args(argv)

    def program():
        if args.json is not None and not args.json.absolute().parent.is_dir():
            raise UserError(f"--json: the folder {args.json.parent} does not exist; make it first.")
        cv2.setNumThreads(1)
        results = measure(args)
        tables, passed = show(results)
        for each in tables:
            Console(width=_WIDTH).print(each, soft_wrap=isinstance(each, str), highlight=False)
        if args.json is not None:
            options = sys.argv[1:] if argv is None else argv
            write_json(args.json, record(parser.prog, options, tables, results))
        return 0 if passed else 1

    return exit_code(program)


def record(program: str, options, tables, results) -> dict:
    """Returns what --json writes: where the figures come from, the tables, and all figures.

    Args:
        program: its name. options: of the command line. tables: as printed. results: measured.
    """
    # Argparse says mapping.py, python -m benchmarks.mapping, or a mixture, as Python's version is.
    name = program.rpartition("benchmarks.")[2].removesuffix(".py")
    words = [f"python -m benchmarks.{name}", *_without_json(options)]
    return {
        "command": " ".join(map(str, words)),
        "commit": _commit(),
        "machine": _machine(),
        "date": datetime.date.today().isoformat(),
        "tables": [_cells(table) for table in tables if isinstance(table, Table)],
        "figures": results,
    }


def _without_json(options) -> list:
    """Returns options without --json and its file, which say nothing about the figures."""
    words = iter(options)
    return [
        word
        for word in words
        if not (word == "--json" and next(words)) and not str(word).startswith("--json=")
    ]


def _commit() -> str:
    """Returns the commit that was measured, with a + if files differ from it."""
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+"]
    try:
        return subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _machine() -> str:
    """Returns the processor, how many there are, and the system."""
    name = platform.machine()
    with contextlib.suppress(OSError):
        models = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
        name = models[0] if models else name
    return f"{name}, {os.cpu_count()} processors, Python {platform.python_version()}"


def _cells(table: Table) -> dict:
    """Returns a table as its title, its headings (None if not shown) and its rows."""
    return {
        "title": str(table.title),
        "headings": [str(c.header) for c in table.columns] if table.show_header else None,
        "rows": [list(map(str, row)) for row in zip(*(c.cells for c in table.columns))],
    }


def progress(items, what: str, total: int | None = None):
    """Yields the items and draws a progress bar with a name."""
    return track(items, what, total=total, console=Console(stderr=True))


def in_processes(jobs, what: str, *, workers: int = 1, jobs_each: int = 1) -> list:
    """Calls functions in new processes, whose numerical libraries use one thread each.

    What one process leaves in memory and in caches is nothing to the next.

    Args:
        jobs: pairs of a function, of a module, and its arguments.
        what: the name of the progress bar.
        workers: number of processes at a time.
        jobs_each: after so many jobs new processes go on.

    Returns:
        what the functions return, in the order of the jobs.
    """
    for name, one in ONE_THREAD.items():
        os.environ.setdefault(name, one)
    jobs = list(jobs)
    return list(progress(_results(jobs, workers, jobs_each), what, total=len(jobs)))


def _results(jobs, workers, jobs_each):
    # Forked from one that has imported what takes seconds, and has done nothing else.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["airrace.diagrams.race"])
    own = threading.local()  # each thread has a process, and waits for no other one

    def call(function, arguments):
        if not getattr(own, "jobs_left", 0):
            if hasattr(own, "process"):
                own.process.shutdown()
            pool = ProcessPoolExecutor(1, context, initializer=_end_with, initargs=(os.getpid(),))
            own.process = stack.enter_context(pool)
            own.jobs_left = jobs_each
        own.jobs_left -= 1
        return own.process.submit(function, *arguments).result()

    with contextlib.ExitStack() as stack:
        threads = stack.enter_context(ThreadPoolExecutor(workers))
        yield from threads.map(call, *zip(*jobs))


def _end_with(main: int) -> None:
    """Has this process end soon after another one that was killed; its parent is the forkserver."""

    def watch():
        with contextlib.suppress(ProcessLookupError):
            while True:
                os.kill(main, 0)
                time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def groups(rows, *keys) -> list:
    """Returns pairs of values of the keys and the rows with them, in order of appearance."""
    found = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(found.items())


def column(rows, key) -> np.ndarray:
    """Returns the values of a key."""
    return np.array([row[key] for row in rows])


def worst(rows, key) -> float:
    """Returns the greatest value of a key; NaN if one is NaN, or if there are no rows."""
    return float(np.max(column(rows, key))) if rows else math.nan


def make_table(title: str, rows, columns: dict) -> Table:
    """Returns a table.

    Args:
        title: above it.
        rows: dictionaries, or whatever the functions in columns take.
        columns: heading to what makes a cell of a row: a format such as "{lap_s:.2f} s" of the
            row's items, or a function. None and NaN are shown as a dash, truth values as words.
    """
    table = Table(title=title)
    for i, heading in enumerate(columns):
        table.add_column(heading, justify="right" if i else "left")
    for row in rows:
        table.add_row(
            *(
                _CELLS.vformat(cell, (), row) if isinstance(cell, str) else str(cell(row))
                for cell in columns.values()
            )
        )
    return table


def make_list(title: str, figures: dict) -> Table:
    """Returns a table of names and values."""
    table = Table(title=title, show_header=False)
    for name, value in figures.items():
        table.add_row(name, f"{value:.3f}" if isinstance(value, float) else str(value))
    return table


class _Cells(string.Formatter):
    def get_value(self, key, args, kwargs):
        return kwargs.get(key)

    def format_field(self, value, format_spec):
        if value is None or value != value:
            return "-"
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, float) and math.isinf(value):
            return "never"
        return format(value, format_spec)


_CELLS = _Cells()
