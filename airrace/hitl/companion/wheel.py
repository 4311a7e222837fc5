"""The wheel of this very checkout, with its uncommitted changes, for a companion computer."""

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

import airrace
from airrace.common.errors import UserError

# Builds by the hook that pyproject.toml's build-backend stands for, without
# pip's build isolation, which would need the network.
_BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
_FOLDERS = ("airrace", "models")
_FILES = ("pyproject.toml", "README.md", "LICENSE")
_BUILD_TIMEOUT = 120  # s


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
        files = (
            [path]
            if path.is_file()
            else sorted(p for p in path.rglob("*") if p.is_file() and not _is_left_behind(p))
        )
        for file in files:
            name = file.relative_to(path.parent).as_posix().encode()
            content = hashlib.sha256(file.read_bytes()).digest()
            result.update(len(name).to_bytes(4, "big") + name + content)
    return result.hexdigest()[:16]


def source_digest(root: Path) -> str:
    """Returns the digest of all that is in the wheel of a checkout."""
    return digest(*(root / name for name in (*_FOLDERS, *_FILES)))


def build_wheel(root: Path, folder: Path) -> Path:
    """Builds the wheel of a checkout; the checkout is left as it is.

    Args:
        root: the checkout.
        folder: an empty folder, for the wheel and what building it leaves.

    Returns:
        the wheel.

    Raises:
        UserError: if that fails.
    """
    source, result = folder / "source", folder / "wheel"
    try:
        for name in _FOLDERS:
            shutil.copytree(
                root / name,
                source / name,
                ignore=lambda _, names: [n for n in names if _is_left_behind(Path(n))],
            )
        for name in _FILES:
            shutil.copy2(root / name, source / name)
        result.mkdir()
        done = subprocess.run(
            [sys.executable, "-I", "-c", _BUILD, str(result)],
            cwd=source,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=_BUILD_TIMEOUT,
        )
        wheels = list(result.glob("*.whl"))
        problem = (done.stderr or done.stdout) if done.returncode or not wheels else None
    except (OSError, shutil.Error, subprocess.TimeoutExpired) as e:
        problem = str(e)
    if problem is not None:
        lines = [line.strip() for line in problem.splitlines() if line.strip()]
        reason = (lines or ["it does not say why"])[-1][:300].rstrip(".")
        remedy = (
            "remove .venv and run ./run.bash again"
            if "setuptools" in reason
            else f"mend the checkout in {root}"
        )
        raise UserError(f"The wheel for the companion cannot be built ({reason}); {remedy}.")
    return wheels[0]


def _is_left_behind(path: Path) -> bool:
    return "__pycache__" in path.parts or path.suffix in (".pyc", ".pyo")
