"""Machine code for functions that work on numbers and small arrays, by Numba.

Where Python's own time counts (control loops, pixels), a function is marked
``@compiled``. The first call compiles it, which takes seconds; the result is kept on disk
beside the byte code of this package. Functions marked ``@compilable`` may be called by
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
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

# Of LLVM's optimization; Numba reads it when it is imported. Level 3, its default, takes a third
# longer to compile, for code that is no faster and computes the same bits.
os.environ.setdefault("NUMBA_OPT", "2")

import numba
import numba.core.event
import numba.extending
import numpy as np

_PACKAGE = Path(__file__).parents[1]


def _cache_folder() -> Path:
    """Returns where the machine code of these very sources is kept.

    Numba notices that the file of a function has changed, but not those of the functions
    and constants that it uses. So the folder is named after the contents of all files
    with compiled functions, and of those that define what they import.
    """
    files = {path: path.read_bytes() for path in sorted(_PACKAGE.rglob("*.py"))}
    compiling = {path for path, text in files.items() if b"airrace.common.jit" in text}
    used = compiling.union(*(_definitions(path, files) for path in compiling))
    digest = hashlib.sha256()
    for path in sorted(used):
        digest.update(files[path])
    return _PACKAGE / "__pycache__" / f"machine_code-{digest.hexdigest()[:16]}"


def _definitions(path, files, name=None):
    """Yields the files that define what a file imports from this package.

    Where a package's __init__.py exports a name of another file, that file is among them.

    Args:
        path: of the file.
        files: the contents of all, by path.
        name: the only name to look for; by default all.
    """
    pattern = rb"\nfrom %b\.?(\S*) import (?:\(([^)]*)\)|(.*))" % _PACKAGE.name.encode()
    for module, lines, line in re.findall(pattern, b"\n" + files[path]):
        folder = _PACKAGE.joinpath(*module.decode().split("."))
        for item in (lines or line).decode().split(","):
            words = item.split()  # such as: a, or: a as b
            if not words or name not in (None, words[-1]):
                continue
            places = folder / f"{words[0]}.py", folder.with_suffix(".py"), folder / "__init__.py"
            for source in [place for place in places if place in files][:1]:
                yield source
                yield from _definitions(source, files, words[0])


if not numba.config.CACHE_DIR:  # $NUMBA_CACHE_DIR
    numba.config.CACHE_DIR = str(_cache_folder())


def is_on_disk() -> bool:
    """Whether machine code of these sources, or some of it, is kept already."""
    return any(Path(numba.config.CACHE_DIR).rglob("*.nbc"))


def is_complete(what: str) -> bool:
    """Whether all machine code of something is kept already: set_complete() was called."""
    return _mark(what).exists()


def set_complete(what: str) -> None:
    """Notes that all machine code of something is kept, until the sources change."""
    _mark(what).parent.mkdir(parents=True, exist_ok=True)
    _mark(what).touch()


def _mark(what: str) -> Path:
    return Path(numba.config.CACHE_DIR) / f"{what}.complete"


@contextlib.contextmanager
def locked() -> Iterator[None]:
    """Lets one process at a time into the ``with`` block: two would compile the same."""
    folder = Path(numba.config.CACHE_DIR)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def remove_stale() -> None:
    """Removes the machine code of sources that have changed since."""
    current = _cache_folder()
    for folder in current.parent.glob("machine_code-*"):
        if folder != current:
            shutil.rmtree(folder, ignore_errors=True)


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
    return numba.njit(cache=True, error_model="numpy")(function)


def compiled_in_threads[F: Callable](function: F) -> F:
    """Returns a function as machine code that several threads of Python run at once.

    It must share nothing that it writes with the others, and calls no Python.
    """
    return numba.njit(cache=True, error_model="numpy", nogil=True)(function)


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
