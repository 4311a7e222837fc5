"""Peers in virtual environments of their own, and what is run in those."""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from airrace.common.processes import ONE_THREAD

ROOT = Path(__file__).parents[2]
_STAMP = "airrace-requirement"  # in an environment that is complete
_TIME_LIMIT = 900  # s, of one program
# One core for each. PYTHONPATH also keeps out what the shell has sourced.
_ENVIRONMENT = {"PYTHONPATH": str(ROOT), **ONE_THREAD, "JAX_PLATFORMS": "cpu", "MPLBACKEND": "Agg"}


class PeerError(Exception):
    """A peer cannot be had or does not fly; one clause that says why."""


def default_folder() -> Path:
    """Returns the folder of the environments, below the user's cache."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "airrace" / "peers"


def add_folder(parser: argparse.ArgumentParser) -> None:
    """Adds the option --folder."""
    parser.add_argument(
        "--folder",
        type=Path,
        default=default_folder(),
        help="of the peers' environments (default: %(default)s)",
    )


def requirements() -> dict[str, str]:
    """Returns name to requirement of the peers: pyproject's extra of that name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return {
        re.match(r"[\w-]+", requirement)[0]: requirement
        for requirement in project["optional-dependencies"]["peers"]
    }


def python_of(folder: Path, name: str, requirement: str) -> Path:
    """Returns the interpreter of a peer's environment.

    Raises:
        PeerError: if that is not there, or of another version of the peer.
    """
    stamp = folder / name / _STAMP
    if not stamp.is_file() or stamp.read_text() != requirement:
        raise PeerError(f"{requirement} is not in {folder}; add --install")
    return folder / name / "bin" / "python"


def install(folder: Path, name: str, requirement: str) -> None:
    """Makes a peer's environment, unless it is there, from pip's package index.

    Raises:
        PeerError: with pip's last words.
    """
    try:
        python_of(folder, name, requirement)
        return
    except PeerError:
        pass
    python = folder / name / "bin" / "python"
    _run([sys.executable, "-m", "venv", "--clear", str(folder / name)])
    _run(
        [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", requirement]
    )
    (folder / name / _STAMP).write_text(requirement)


def fly(python: Path | str, module: str, *options: object) -> dict:
    """Runs one of the fly_*.py or step_*.py; returns what it printed last, which is JSON.

    Raises:
        PeerError: with its last words.
    """
    words = [str(python), "-m", f"benchmarks.peers.{module}", *map(str, options)]
    output = _run(words).splitlines()
    try:
        return json.loads(output[-1])
    except (IndexError, json.JSONDecodeError):
        raise PeerError(f"{module} printed no result") from None


def _run(command) -> str:
    try:
        with tempfile.TemporaryDirectory() as scratch:  # MuJoCo leaves a log where it is run
            done = subprocess.run(
                command,
                cwd=scratch,
                env=os.environ | _ENVIRONMENT,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
                timeout=_TIME_LIMIT,
            )
    except OSError as e:
        raise PeerError(f"{command[0]} cannot be run: {e.strerror}") from None
    except subprocess.TimeoutExpired:
        raise PeerError(f"{' '.join(command[1:])} took more than {_TIME_LIMIT} s") from None
    if done.returncode:
        words = (done.stderr.strip() or done.stdout.strip() or "no words").splitlines()
        raise PeerError(words[-1].removeprefix("ERROR: ").rstrip("."))
    return done.stdout
