"""What holds the tree together: imports run downwards, and importing does nothing else."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_layers_import_downwards_only():
    """The contract is in pyproject.toml; `lint-imports` on the command line says more."""
    command = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports())"
    done = subprocess.run([sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr


def test_tests_do_not_import_benchmarks():
    """Worlds that both need are in tests/worlds/."""
    pattern = re.compile(r"^\s*(from|import) benchmarks\b", re.MULTILINE)
    files = (ROOT / "tests").rglob("*.py")
    assert not [path for path in files if pattern.search(path.read_text(encoding="utf-8"))]


def test_every_folder_says_what_it_is():
    for folder in (ROOT / "airrace").rglob("__init__.py"):
        if "lcmtypes" not in folder.parts:
            text = folder.read_text(encoding="utf-8")
            assert text.startswith('"""'), folder
