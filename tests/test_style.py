"""One style and sound types everywhere: what ruff and mypy say, with their settings in pyproject.toml."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def _run(tool, *arguments):
    """Runs a tool on the checkout; it must be content."""
    if importlib.util.find_spec(tool) is None:
        pytest.skip(f"{tool} is not installed: it is one of the dev dependencies")
    command = [sys.executable, "-m", tool, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr


def test_ruff_finds_nothing():
    _run("ruff", "check", "--quiet", ".")


def test_all_is_formatted():
    _run("ruff", "format", "--check", "--quiet", ".")


@pytest.mark.slow
def test_types_fit():
    _run("mypy")
