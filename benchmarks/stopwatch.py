"""Tells how long each box of a diagram takes."""

import contextlib
import functools
import importlib
import time
from unittest import mock

from pydrake.systems.framework import LeafSystem

# Every method of LeafSystem that takes callbacks.
_DECLARATIONS = [
    name
    for name in dir(LeafSystem)
    if name.startswith("Declare")
    and name.endswith(("Event", "OutputPort"))
    and name != "DeclareStateOutputPort"
]


class Stopwatch:
    """Sums up the CPU time of functions, each without those that it calls.

    At any time exactly one row is running, so the rows add up to the whole.
    A call costs two looks at the clock, about a microsecond.

    Attributes:
        rows: name to [seconds, calls].
    """

    def __init__(self, rest: str):
        """Args: rest: the row of all that is not wrapped."""
        self.rows = {rest: [0.0, 0]}
        self._row = self.rows[rest]
        self._since = time.process_time()

    def snapshot(self) -> dict:
        """Returns name to (seconds, calls) of all rows up to now."""
        self._switch(self._row)
        return {name: tuple(row) for name, row in self.rows.items()}

    def wrapped(self, name: str, function):
        """Returns a function whose time counts for the row of that name."""
        row = self.rows.setdefault(name, [0.0, 0])

        @functools.wraps(function)
        def call(*args, **kwargs):
            caller = self._row
            self._switch(row)
            row[1] += 1
            try:
                return function(*args, **kwargs)
            finally:
                self._switch(caller)

        return call

    def _switch(self, row):
        now = time.process_time()
        self._row[0] += now - self._since
        self._row, self._since = row, now


@contextlib.contextmanager
def watching(stopwatch: Stopwatch, parts: dict):
    """Gives every LeafSystem in Python that is made meanwhile a row: its class's.

    Args:
        stopwatch: of the rows.
        parts: "module:name" or "module:Class.name" of more functions to the
            names of their rows.
    """
    with contextlib.ExitStack() as stack:
        for name in _DECLARATIONS:
            method = _watched_declaration(stopwatch, getattr(LeafSystem, name))
            stack.enter_context(mock.patch.object(LeafSystem, name, method))
        for path, row in parts.items():
            module, _, name = path.partition(":")
            owner = importlib.import_module(module)
            *classes, attribute = name.split(".")
            for each in classes:
                owner = getattr(owner, each)
            function = stopwatch.wrapped(row, getattr(owner, attribute))
            stack.enter_context(mock.patch.object(owner, attribute, function))
        yield


def _watched_declaration(stopwatch: Stopwatch, declare):
    def declare_watched(system, *args, **kwargs):
        def watched(argument):
            if not callable(argument) or isinstance(argument, type):
                return argument
            return stopwatch.wrapped(type(system).__name__, argument)

        return declare(
            system,
            *map(watched, args),
            **{key: watched(argument) for key, argument in kwargs.items()},
        )

    return declare_watched
