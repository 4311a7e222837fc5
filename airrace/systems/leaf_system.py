"""A LeafSystem that goes away with its diagram."""

import functools
import types
import weakref
from collections.abc import Callable
from typing import Any

from pydrake.systems import framework

_CALLABLE = (types.FunctionType, types.MethodType, functools.partial)


class LeafSystem(framework.LeafSystem):
    """Drake's LeafSystem, which Python can free.

    Drake keeps what a system declares in C++, where Python's garbage collection does not look.
    A system that declares its own methods would hold on to itself there for ever, and so would the
    diagram around it, some megabytes for each race. This one keeps its callbacks itself, and gives
    Drake weak references to them. It has nothing else of its own.
    """

    def held(self, callback: Callable) -> Callable:
        """Returns what Drake may keep in the place of a callback of this system.

        The Declare... methods do this by themselves; it is for callbacks that Drake gets otherwise.
        """
        self.__dict__.setdefault("_held", []).append(callback)
        reference = weakref.ref(callback)

        def call(*args: Any) -> Any:
            kept = reference()
            assert kept is not None  # Drake calls no system that is gone
            return kept(*args)

        return call


def _holding(declare: Any) -> Any:
    """Returns a Declare... method that holds the callbacks among its arguments."""

    def declare_held(self, *args, **kwargs):
        """Does what Drake's does.

        :meta private:
        """

        def held(each):
            return self.held(each) if isinstance(each, _CALLABLE) else each

        return declare(self, *map(held, args), **{k: held(v) for k, v in kwargs.items()})

    declare_held.__name__ = declare.__name__
    return declare_held


for _name in dir(framework.LeafSystem):
    if _name.startswith("Declare"):
        setattr(LeafSystem, _name, _holding(getattr(framework.LeafSystem, _name)))
