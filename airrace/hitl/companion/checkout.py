"""This very checkout, with its uncommitted changes, for a companion computer."""

from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.files import digest, files_in
from airrace.common.resources import PACKAGE

LOCK = "requirements-run.lock"  # what running takes, without what developing takes
_FOLDERS = ("airrace", "models")


def checkout_path() -> Path:
    """Returns the folder of the checkout that this airrace runs from.

    Raises UserError if it runs from an installed package.
    """
    root = PACKAGE.parent
    if not all((root / name).is_file() for name in ("pyproject.toml", LOCK)):
        raise UserError(
            f"airrace runs from {root}, which is no checkout of it, so that it cannot "
            "be brought to a companion; start it with ./run.bash of a checkout."
        )
    return root


def source_digest(root: Path) -> str:
    """Returns the digest of all of a checkout that a companion gets."""
    return digest(*(root / name for name in _FOLDERS))


def source_files(root: Path) -> dict[str, bytes]:
    """Returns all of a checkout that a companion gets: path to contents.

    Raises UserError if a file cannot be read.
    """
    try:
        return {
            file.relative_to(root).as_posix(): file.read_bytes()
            for file in files_in(*(root / name for name in _FOLDERS))
        }
    except OSError as e:
        raise UserError(
            f"{e.filename} cannot be read ({e.strerror}), so that airrace cannot be brought to "
            f"the companion; mend the checkout in {root}."
        ) from None
