"""An airrace that is installed has all that one in a checkout has."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The hook of pyproject.toml's build-backend, without pip's isolation, which needs the network.
BUILD = "import sys; import setuptools.build_meta as m; getattr(m, sys.argv[1])(sys.argv[2])"


def build(folder, hook) -> Path:
    """Makes a wheel in a folder, of a copy of the checkout in folder/source; returns its path."""
    for name in ("airrace", "models"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=ignore)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source" / name)
    command = [sys.executable, "-I", "-c", BUILD, hook, str(folder)]
    subprocess.run(command, cwd=folder / "source", check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_an_editable_install_uses_the_checkout(tmp_path):
    """`pip install -e`, as the lessons say: what is edited takes effect."""
    wheel = build(tmp_path, "build_editable")
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    code = "import site, sys; site.addsitedir(sys.argv[1]); import airrace; print(airrace.__file__)"
    python = [sys.executable, "-I", "-S", "-c", code, str(tmp_path / "site")]
    done = subprocess.run(python, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # models/ is found beside the package, see models_path().
    assert Path(done.stdout.strip()) == tmp_path / "source" / "airrace" / "__init__.py"


def test_wheel_has_all_that_a_race_needs(tmp_path):
    names = set(zipfile.ZipFile(build(tmp_path, "build_wheel")).namelist())
    for pattern in ("airrace/**/*.py", "airrace/**/*.sh", "airrace/**/*.html", "airrace/**/*.lcm"):
        assert {path.relative_to(ROOT).as_posix() for path in ROOT.glob(pattern)} <= names
    models = {
        f"airrace/{path.relative_to(ROOT).as_posix()}"
        for path in (ROOT / "models").rglob("*")
        if path.is_file()
    }
    assert models <= names
