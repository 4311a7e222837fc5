"""Folders that are held while somebody uses them, and removed when nobody does any more.

Who is killed removes nothing. But its locks end with it: so the next one sees what was left.
"""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

_PREFIX = "airrace-held-"
_YOUNG = 60.0  # s, for which a folder may not be held yet by who has just made it


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """Makes a folder, and removes it after the ``with`` block, with all that is in it.

    Those of processes that were killed are removed, too.
    """
    remove_abandoned(Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"), _remove)
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    try:
        with held(folder):
            yield folder
    finally:
        _remove(folder)


@contextlib.contextmanager
def held(folder: Path, alone: bool = False) -> Iterator[None]:
    """Keeps a folder from being removed as abandoned, until the ``with`` block or the process ends.

    Where the file system knows no locks, nothing is ever removed.

    Args: folder: to hold. alone: whether nobody else may hold it.

    Raises:
        BlockingIOError: if alone, and somebody else holds it.
    """
    with _opened(folder) as descriptor:
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except OSError as e:
            if alone and isinstance(e, BlockingIOError):
                raise
        yield


def remove_abandoned(folders: Iterable[Path], remove: Callable[[Path], object]) -> None:
    """Removes those of some folders that are this user's, old, and held by nobody.

    Args: folders: to look at. remove: removes one; it may raise OSError.
    """
    for folder in folders:
        with contextlib.suppress(OSError), _opened(folder) as descriptor:
            status = os.fstat(descriptor)
            if status.st_uid == os.getuid() and time.time() - status.st_mtime > _YOUNG:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                remove(folder)


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[int]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
