"""This very checkout, with its uncommitted changes, for a companion computer."""

import hashlib
import io
import tarfile
from pathlib import Path

import airrace
from airrace.common.errors import UserError

_FOLDERS = ("airrace", "models")


def checkout_path() -> Path:
    """Returns the folder of the checkout that this airrace runs from.

    Raises:
        UserError: if it runs from an installed package.
    """
    root = Path(airrace.__file__).resolve().parent.parent
    if not all((root / name).is_file() for name in ("pyproject.toml", "requirements.lock")):
        raise UserError(
            f"airrace runs from {root}, which is no checkout of it, so that it cannot "
            "be brought to a companion; start it with ./run.bash of a checkout."
        )
    return root


def digest(*paths: Path) -> str:
    """Returns sixteen hexadecimal digits for the contents of files and folders.

    Names below the folders count, places and times do not; nor does what Python leaves behind.
    """
    result = hashlib.sha256()
    for path in paths:
        for file in _files(path):
            name = file.relative_to(path.parent).as_posix().encode()
            content = hashlib.sha256(file.read_bytes()).digest()
            result.update(len(name).to_bytes(4, "big") + name + content)
    return result.hexdigest()[:16]


def source_digest(root: Path) -> str:
    """Returns the digest of all of a checkout that a companion gets."""
    return digest(*(root / name for name in _FOLDERS))


def pack(root: Path) -> bytes:
    """Returns a tar archive of all of a checkout that a companion gets.

    Raises:
        UserError: if a file cannot be read.
    """
    result = io.BytesIO()
    try:
        with tarfile.open(fileobj=result, mode="w") as archive:
            for name in _FOLDERS:
                for file in _files(root / name):
                    archive.add(file, file.relative_to(root).as_posix())
    except OSError as e:
        raise UserError(
            f"{e.filename} cannot be read ({e.strerror}), so that airrace cannot be brought to "
            f"the companion; mend the checkout in {root}."
        ) from None
    return result.getvalue()


def _files(path: Path) -> list[Path]:
    """Returns a file, or those in a folder, in order, without what Python leaves behind."""
    if path.is_file():
        return [path]
    return sorted(
        file
        for file in path.rglob("*")
        if file.is_file()
        and "__pycache__" not in file.parts
        and file.suffix not in (".pyc", ".pyo")
    )
