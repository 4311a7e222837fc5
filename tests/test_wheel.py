"""An airrace that is installed has all that one in a checkout has."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The hook of pyproject.toml's build-backend, without pip's isolation, which needs the network.
BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"


def test_wheel_has_all_that_a_race_needs(tmp_path):
    for name in ("airrace", "models"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / "source" / name, ignore=ignore)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / "source" / name)
    command = [sys.executable, "-I", "-c", BUILD, str(tmp_path)]
    subprocess.run(command, cwd=tmp_path / "source", check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*-py3-none-any.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for pattern in ("airrace/**/*.py", "airrace/**/*.sh", "airrace/**/*.html", "airrace/**/*.lcm"):
        assert {path.relative_to(ROOT).as_posix() for path in ROOT.glob(pattern)} <= names
    models = {
        f"airrace/{path.relative_to(ROOT).as_posix()}"
        for path in (ROOT / "models").rglob("*")
        if path.is_file()
    }
    assert models <= names
