"""Where the machine code of this package is kept, and of which sources it is."""

import contextlib
import functools
import hashlib
import os
import re
import shutil
import stat
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


@functools.cache
def sources_digest(package: Path) -> str:
    """Returns sixteen hexadecimal digits for the sources that machine code is made of.

    Those are all files with compiled functions, and those that define what they import. Their
    places and times do not count.

    Args:
        package: the folder of the package.
    """
    files = {path: path.read_bytes() for path in sorted(package.rglob("*.py"))}
    compiling = {path for path, text in files.items() if b"airrace.common.jit" in text}
    used = compiling.union(*(_definitions(path, files, package) for path in compiling))
    digest = hashlib.sha256()
    for path in sorted(used):
        digest.update(files[path])
    return digest.hexdigest()[:16]


def _definitions(path, files, package, name=None):
    """Yields the files that define what a file imports from this package.

    Where a package's __init__.py exports a name of another file, that file is among them.

    Args:
        path: of the file.
        files: the contents of all, by path.
        package: the folder of the package.
        name: the only name to look for; by default all.
    """
    pattern = rb"\nfrom %b\.?(\S*) import (?:\(([^)]*)\)|(.*))" % package.name.encode()
    for module, lines, line in re.findall(pattern, b"\n" + files[path]):
        folder = package.joinpath(*module.decode().split("."))
        for item in (lines or line).decode().split(","):
            words = item.split()  # such as: a, or: a as b
            if not words or name not in (None, words[-1]):
                continue
            places = folder / f"{words[0]}.py", folder.with_suffix(".py"), folder / "__init__.py"
            for source in [place for place in places if place in files][:1]:
                yield source
                yield from _definitions(source, files, package, words[0])


def choose_folder(package: Path = PACKAGE) -> Path:
    """Returns the folder for the machine code of a package; its name says of which sources it is.

    It is beside the byte code, where who installed the package can write. Others have one in
    $XDG_CACHE_HOME or ~/.cache, or at last in the temporary folder; what is in the first one
    already is copied there.

    Args:
        package: the folder of the package.
    """
    name = f"machine_code-{sources_digest(package)}"
    beside = package / "__pycache__" / name
    if _is_writable(beside):
        return beside
    folder = own_folder() / name
    if beside.is_dir() and not folder.exists():
        _copy(beside, folder)
    return folder


def usual_folder() -> Path:
    """Returns where this user's own_folder() is, if it can be written to."""
    home = os.path.expanduser("~/.cache")  # as it is if nobody knows the home
    return Path(os.environ.get("XDG_CACHE_HOME") or home) / "airrace"


def own_folder() -> Path:
    """Returns the folder of this user for what can be made again."""
    folder = usual_folder()
    if folder.is_absolute() and _is_writable(folder):
        return folder
    # Machine code of another user would run as this one: the folder must be one's own.
    folder = Path(tempfile.gettempdir()) / f"airrace-{os.getuid()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700)
    status = folder.lstat() if os.path.lexists(folder) else None
    mine = status is not None and stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    if status is not None and mine and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return folder
    return Path(tempfile.mkdtemp(prefix="airrace-"))


def _is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, or else the folder can."""
    # os.path's, unlike pathlib's, says of what is hidden from this user that it is not there.
    there = next(path for path in (folder, *folder.parents) if os.path.exists(path))
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _copy(source: Path, target: Path) -> None:
    """Copies a folder, which others see whole or not at all; if it cannot be, none is there."""
    part = target.with_name(f"{target.name}.{os.getpid()}")
    try:
        shutil.copytree(source, part)
        part.rename(target)
    except OSError:  # also if another process was quicker
        shutil.rmtree(part, ignore_errors=True)
