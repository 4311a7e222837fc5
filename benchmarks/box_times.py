"""The CPU time of every box of a diagram."""

import contextlib
import functools
import itertools
import pkgutil
import time
from collections import Counter
from unittest import mock

from pydrake.systems import framework

from airrace.systems.leaf_system import LeafSystem

# Every method of LeafSystem that takes callbacks.
_DECLARATIONS = [
    name
    for name in dir(LeafSystem)
    if name.startswith("Declare")
    and name.endswith(("Event", "OutputPort"))
    and name != "DeclareStateOutputPort"
]


class BoxTimes:
    """CPU time and calls of boxes, each without the boxes that it calls.

    At any time exactly one row is running, so the rows add up to the whole.

    Attributes:
        calls: row to number of calls.
    """

    def __init__(self, rest: str):
        """Args: rest: the row of all that is in no box."""
        self.calls, self._seconds = Counter(), Counter()
        self._row, self._since = rest, time.process_time()

    def seconds(self) -> Counter:
        """Returns row to CPU time so far (s)."""
        self._switch(self._row)
        return self._seconds.copy()

    @contextlib.contextmanager
    def measuring(self, parts: dict):
        """Measures every LeafSystem in Python that is constructed meanwhile, by its class.

        Args:
            parts: more functions, "module.name" or "module.Class.name", to their rows.
        """
        with contextlib.ExitStack() as stack:
            # Boxes of airrace's LeafSystem, and others that are Drake's.
            for kind, name in itertools.product((LeafSystem, framework.LeafSystem), _DECLARATIONS):
                method = self._measured_declaration(getattr(kind, name))
                stack.enter_context(mock.patch.object(kind, name, method))
            for path, row in parts.items():
                function = self._measured(row, pkgutil.resolve_name(path))
                stack.enter_context(mock.patch(path, function))
            yield

    def _measured(self, row: str, function):
        @functools.wraps(function)
        def call(*args, **kwargs):
            self.calls[row] += 1
            caller = self._switch(row)
            try:
                return function(*args, **kwargs)
            finally:
                self._switch(caller)

        return call

    def _measured_declaration(self, declare):
        def declare_measured(system, *args, **kwargs):
            def measured(argument):
                is_callback = callable(argument) and not isinstance(argument, type)
                return self._measured(type(system).__name__, argument) if is_callback else argument

            kwargs = {name: measured(argument) for name, argument in kwargs.items()}
            return declare(system, *map(measured, args), **kwargs)

        return declare_measured

    def _switch(self, row: str) -> str:
        """Lets another row run, and returns the one that ran."""
        now = time.process_time()
        self._seconds[self._row] += now - self._since
        previous, self._row, self._since = self._row, row, now
        return previous
