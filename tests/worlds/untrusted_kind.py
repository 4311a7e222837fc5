"""What a kind of input from outside is: something sound, how it gets broken, and what takes it."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from airrace.common.errors import UserError


class WrongResult(Exception):
    """What was read is not what the file says, and nobody said so."""


class Kind(NamedTuple):
    """A kind of input from outside.

    What a kind needs for all of its inputs, its make() leaves in the folder that it is given.
    """

    name: str
    #: make: writes what is sound into a new folder, and returns the file that is to be mutated.
    make: Callable[[Path], Path]
    #: mutate: random numbers and the file's bytes to other bytes.
    mutate: Callable[[Random, bytes], bytes]
    #: read: reads the file; raises UserError if that says what is wrong with it, WrongResult.
    read: Callable[[Path], Any]
    slow: bool = False  #: whether it takes about a second


def try_input(kind: Kind, path: Path, data: bytes) -> None:
    """Reads a mutated file; raises what its reader raises, but for UserError.

    Args: path: of make(); it holds the input afterwards.
    """
    path.write_bytes(data)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.suppress(UserError):
        kind.read(path)
