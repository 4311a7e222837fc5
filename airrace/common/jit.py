"""Machine code for functions that work on numbers and small arrays, by Numba.

Where Python's own time counts (control loops, pixels), a function is written as
plainly as in C and marked ``@compiled``. The first call compiles it, which takes
seconds; the result is kept on disk beside the byte code of this package. Functions
marked ``@compilable`` may be called by compiled ones, and stay Python otherwise:
with numbers or arrays alike.
"""

import hashlib
import math
import re
import shutil
from pathlib import Path

import numba
import numba.extending

_PACKAGE = Path(__file__).parents[1]


def _cache_folder() -> Path:
    """Returns where the machine code of these very sources is kept.

    Numba sees that the file of a function has changed, but not those of the functions
    and constants that it uses. So the folder is named after the contents of all files
    with compiled functions, and of those that they import from.
    """
    files = {path: path.read_bytes() for path in sorted(_PACKAGE.rglob("*.py"))}
    used = {path for path, text in files.items() if b"airrace.common.jit" in text}
    imports = re.compile(rb"^from %b\.?(\S*) import (.*)$" % _PACKAGE.name.encode(), re.M)
    for path in list(used):
        for line in imports.findall(files[path]):
            module = [_PACKAGE.joinpath(*line[0].decode().split("."))]
            module += [module[0] / name.strip() for name in line[1].decode().split(",")]
            used |= {each.with_suffix(".py") for each in module} & files.keys()
    digest = hashlib.sha256()
    for path in sorted(used):
        digest.update(files[path])
    return _PACKAGE / "__pycache__" / f"machine_code-{digest.hexdigest()[:16]}"


if not numba.config.CACHE_DIR:  # $NUMBA_CACHE_DIR
    numba.config.CACHE_DIR = str(_cache_folder())


def is_on_disk() -> bool:
    """Whether machine code of these sources, or some of it, is kept already."""
    return any(Path(numba.config.CACHE_DIR).rglob("*.nbc"))


def remove_stale() -> None:
    """Removes the machine code of sources that have changed since."""
    folder = Path(numba.config.CACHE_DIR)
    for old in (_PACKAGE / "__pycache__").glob("machine_code-*"):
        if old != folder:
            shutil.rmtree(old, ignore_errors=True)


compilable = numba.extending.register_jitable


def compiled(function):
    """Returns a function as machine code; a decorator.

    A division by zero gives infinity or NaN there, as with arrays.
    """
    return numba.njit(cache=True, error_model="numpy")(function)


@compiled
def all_finite(vector) -> bool:
    """Whether all numbers of an array (n,) are finite."""
    for number in vector:
        if not math.isfinite(number):
            return False
    return True
