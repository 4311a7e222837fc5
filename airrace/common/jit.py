"""Machine code for functions that work on numbers and small arrays, by Numba.

Where Python's own time counts (control loops, pixels), a function is marked
``@compiled``. The first call compiles it, which takes seconds; the result is kept on disk
in a folder of its own (machine_code.py). Functions marked ``@compilable`` may be called by
compiled ones, and stay Python otherwise: with numbers or arrays alike; those marked
``@inlined`` too, and they are for innermost loops. What has parts is a NamedTuple of numbers
and arrays. To hand one over from Python takes Numba longer than a controller computes; so
loops of hundreds of hertz hand over a plain tuple or a vector, of which the compiled function
makes the NamedTuple again (packing.py).
"""

import contextlib
import fcntl
import hashlib
import math
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

# Of LLVM's optimization; Numba reads it when it is imported. Level 3, its default, takes a third
# longer to compile, for code that is no faster and computes the same bits.
os.environ.setdefault("NUMBA_OPT", "2")

import numba
import numba.core.event
import numba.extending
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.registry import cpu_target

from airrace.common.errors import UserError, words
from airrace.common.machine_code import PACKAGE, choose_folder, sources_digest

if not numba.config.CACHE_DIR:  # $NUMBA_CACHE_DIR
    numba.config.CACHE_DIR = str(choose_folder())


def is_complete(what: str) -> bool:
    """Whether all machine code of something is kept already, for this processor.

    That is if set_complete() was called, and nothing has been removed since.
    """
    try:
        count = int(_mark(what).read_text())
    except (OSError, ValueError):
        return False
    return _count_kept() >= count


def set_complete(what: str) -> None:
    """Notes that all machine code of something is kept, until the sources change."""
    with contextlib.suppress(OSError):  # then it is looked for again
        _mark(what).parent.mkdir(parents=True, exist_ok=True)
        _mark(what).write_text(str(_count_kept()))


def _mark(what: str) -> Path:
    # Numba takes only what it has compiled itself, for the same processor.
    maker = numba.__version__, sys.version, cpu_target.target_context.codegen().magic_tuple()
    name = hashlib.sha256(repr(maker).encode()).hexdigest()[:8]
    return Path(numba.config.CACHE_DIR) / f"{what}-{name}.complete"


def _count_kept() -> int:
    return sum(1 for _ in Path(numba.config.CACHE_DIR).rglob("*.nbc"))


@contextlib.contextmanager
def locked() -> Iterator[None]:
    """Lets one process at a time into the ``with`` block: two would compile the same.

    Raises:
        UserError: if nothing can be kept.
    """
    folder = Path(numba.config.CACHE_DIR)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / "lock").open("w")
    except OSError as e:
        raise UserError(
            f"Machine code cannot be kept in {folder} ({words(e)}): make room there, or set "
            "NUMBA_CACHE_DIR to a folder that you can write to."
        ) from None
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def remove_stale() -> None:
    """Removes the machine code of sources that have changed since, if it is beside them."""
    current = choose_folder(PACKAGE)
    if current.parent == PACKAGE / "__pycache__":  # else other installations may keep theirs there
        for folder in current.parent.glob("machine_code-*"):
            if folder != current:
                shutil.rmtree(folder, ignore_errors=True)


class _Locator(_CacheLocator):
    """Says where the machine code of a function of this package is.

    Numba's own locators go by the path of the source, so that they know nothing any more of a
    package that was moved, and notice no change in what a function calls.
    """

    def __init__(self, place: str, line: int):
        self._place, self._line = place, line

    def get_cache_path(self):
        return os.path.join(numba.config.CACHE_DIR, self._place)

    def get_source_stamp(self):
        return sources_digest(PACKAGE)

    def get_disambiguator(self):
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Callable, py_file: str) -> "_Locator | None":
        file = Path(py_file)
        if not file.is_relative_to(PACKAGE):
            return None
        place = ".".join((PACKAGE.name, *file.parent.relative_to(PACKAGE).parts))
        return cls(place, py_func.__code__.co_firstlineno)


class _Results(CompileResultCacheImpl):
    _locator_classes = (_Locator, *CompileResultCacheImpl._locator_classes)


class _Cache(FunctionCache):
    """Numba's cache on disk; where it cannot be read or written, it is done without."""

    _impl_class = _Results

    def load_overload(self, sig, target_context):
        with contextlib.suppress(Exception):  # also if a file of it is damaged
            return super().load_overload(sig, target_context)

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError:
            pass
        except Exception:  # its index is damaged, which is read before
            with contextlib.suppress(OSError):
                self.flush()
                super().save_overload(sig, data)


@contextlib.contextmanager
def watched(show: Callable[[int], object]) -> Iterator[None]:
    """Calls show() after each function that is compiled, with how many have been, meanwhile.

    Those that are read from the disk do not count.
    """

    class Listener(numba.core.event.Listener):
        count = 0

        def on_start(self, event):
            pass

        def on_end(self, event):
            self.count += 1
            show(self.count)

    with numba.core.event.install_listener("numba:compile", Listener()):
        yield


def announce() -> None:
    """Says so, once, if from here on something of this package is compiled in this process."""

    class Listener(numba.core.event.Listener):
        said = False

        def on_start(self, event):
            name = event.data["dispatcher"].py_func.__module__
            if not self.said and name.startswith(f"{PACKAGE.name}."):
                self.said = True
                print("airrace: compiling, once; it takes about a minute", file=sys.stderr)

        def on_end(self, event):
            pass

    numba.core.event.register("numba:compile", Listener())


compilable = numba.extending.register_jitable


def inlined[F: Callable](function: F) -> F:
    """Returns a function that is compilable, and whose machine code stands in that of its callers.

    A loop with a call in it is not computed for several numbers at once (SIMD), and at each call
    the references to all arrays of a NamedTuple are counted; in the innermost loops of many drones
    the two took half of the time. Elsewhere it only makes longer machine code.
    """
    return numba.extending.register_jitable(forceinline=True)(function)


def compiled[F: Callable](function: F) -> F:
    """Returns a function as machine code; a decorator.

    A division by zero gives infinity or NaN there, as with arrays.
    """
    return _kept(numba.njit(error_model="numpy")(function))


def compiled_in_threads[F: Callable](function: F) -> F:
    """Returns a function as machine code that several threads of Python run at once.

    It must share nothing that it writes with the others, and calls no Python.
    """
    return _kept(numba.njit(error_model="numpy", nogil=True)(function))


def _kept(dispatcher):
    dispatcher._cache = _Cache(getattr(dispatcher, "py_func", dispatcher))
    return dispatcher


@compilable
def assign(vector: np.ndarray, values: np.ndarray) -> None:
    """Writes the first n of some numbers into an array, (n,), one by one.

    Numba makes ten times as many instructions of ``vector[:] = values``, for whatever shapes
    there are; in loops of hundreds of hertz they push other code out of the processor's caches.
    """
    for i in range(len(vector)):
        vector[i] = values[i]


@compiled
def all_finite(vector: np.ndarray) -> bool:
    """Whether all numbers of an array (n,) are finite."""
    for number in vector:
        if not math.isfinite(number):
            return False
    return True
