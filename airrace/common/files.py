"""Results that a reader never sees half of, and what is in a folder."""

import contextlib
import datetime
import errno
import hashlib
import itertools
import json
import math
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from airrace.common.errors import UserError
from airrace.common.held_folders import held, remove_abandoned

# What an evaluation leaves in its folder, where no race may be kept.
EVALUATION = (
    "races.jsonl",
    "evaluation.json",
    "evaluation.md",
    "evaluation.png",
    "evaluation.html",
)


def open_regular(path: Path) -> BinaryIO:
    """Opens a file of somebody else's for reading, which waits for nobody who would write it.

    Raises:
        OSError: if it cannot be read, or is a pipe, a folder or a device.
    """
    file = open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is no file")
    return file


def read_regular(path: Path, most: int) -> bytes:
    """Returns what is in a file, at most so many bytes; see open_regular()."""
    with open_regular(path) as file:
        return file.read(most)


def write_text(path: Path, text: str) -> None:
    """Replaces a file at once: readers see the old text or the new one.

    Raises:
        UserError: if it cannot be written; the old text stays.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Like write_text(), of bytes."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except BaseException as e:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(e, OSError):
            raise UserError(
                f"{path} cannot be written ({e.strerror}); make room there or write elsewhere."
            ) from None
        raise


def write_json(path: Path, data: Any) -> None:
    """Writes JSON for people and programs; NaN and infinity, which JSON lacks, as null."""
    write_text(path, json.dumps(finite(data), indent=1, allow_nan=False) + "\n")


def finite(data: Any) -> Any:
    """Returns plain data with None in place of NaN and infinity."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


def files_in(*paths: Path) -> list[Path]:
    """Returns files, and those in folders, in order, without what Python leaves behind."""
    found = {file for path in paths for file in (path.rglob("*") if path.is_dir() else [path])}
    return sorted(
        file
        for file in found
        if file.is_file() and "__pycache__" not in file.parts and file.suffix != ".pyc"
    )


def digest(*paths: Path) -> str:
    """Returns sixteen hexadecimal digits for the contents of files and folders.

    Names below the folders count, places and times do not; nor does what Python leaves behind.
    """
    result = hashlib.sha256()
    for path in paths:
        for file in files_in(path):
            name = file.relative_to(path.parent).as_posix().encode()
            content = hashlib.sha256(file.read_bytes()).digest()
            result.update(len(name).to_bytes(4, "big") + name + content)
    return result.hexdigest()[:16]


_STAMPED = "[0-9]" * 8 + "T" + "[0-9]" * 6 + "Z-*"  # what run_path() makes


def run_path(*names: str) -> Path:
    """Returns runs/<UTC time>-<names>: where results go if nobody says where."""
    stamp = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%SZ")
    # Tracks and drones may be called anything; a folder is typed and quoted in shells.
    return Path("runs") / "-".join([stamp, *(re.sub(r"[^\w.-]+", "-", n)[:60] for n in names)])


@contextlib.contextmanager
def results_folder(path: Path, *, numbered: bool = False, refuse: tuple = ()) -> Iterator[Path]:
    """Creates a folder for the results of the ``with`` block, and yields its path.

    If the block is left by an exception before it has left anything in the folder,
    whatever was created is removed again. Where names are made up, empty folders of processes
    that were killed are removed, too.

    Args:
        path: the folder.
        numbered: whether to take path-2, path-3, ... if it exists already, so
            that two runs started at once never share a folder.
        refuse: names of files that must not be in the folder yet.

    Raises:
        UserError: if it cannot be written to, holds one of those files, or is being written to.
    """
    if numbered:
        remove_abandoned(path.parent.glob(_STAMPED), Path.rmdir)
    for copy in itertools.count(1):
        folder = path if copy == 1 else path.with_name(f"{path.name}-{copy}")
        created = [p for p in (folder, *folder.parents) if not os.path.exists(p)]
        try:
            folder.mkdir(parents=True, exist_ok=not numbered)
            tempfile.TemporaryFile(dir=folder).close()
            break
        except OSError as e:
            if numbered and isinstance(e, FileExistsError):
                continue
            _remove_empty(created)
            raise UserError(
                f"--output {folder} cannot be written to ({e.strerror}); name another folder."
            ) from None
    try:
        with contextlib.ExitStack() as stack:
            _claim(stack, folder, refuse)
            yield folder
    except BaseException:
        _remove_empty(created)
        raise


def _claim(stack: contextlib.ExitStack, folder: Path, refuse: tuple) -> None:
    """Holds a folder while a stack is open; raises UserError if it is somebody else's."""
    try:
        stack.enter_context(held(folder, alone=bool(refuse)))
    except BlockingIOError:
        raise UserError(
            f"--output {folder} is written to by another program; name another folder."
        ) from None
    for name in refuse:
        if os.path.lexists(folder / name):
            raise UserError(
                f"--output {folder} already holds results ({name}); name another folder or "
                "remove it."
            )


def _remove_empty(folders):
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()
