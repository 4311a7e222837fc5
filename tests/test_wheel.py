"""An airrace that is installed has all that one in a checkout has, and can be put on an index."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

import airrace

ROOT = Path(__file__).parents[1]
# The hooks of pyproject.toml's build-backend, without pip's isolation, which needs the network.
BUILD = """
import sys
from setuptools import build_meta
getattr(build_meta, sys.argv[1])(sys.argv[2])
"""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder with a wheel and a source distribution; nothing is written to the checkout."""
    folder = tmp_path_factory.mktemp("dist")
    for name in ("airrace", "models"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / "source" / name, ignore=ignore)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source" / name)
    (folder / "editable").mkdir()
    for hook in ("build_sdist", "build_wheel", "build_editable"):
        target = folder / "editable" if hook == "build_editable" else folder
        command = [sys.executable, "-I", "-c", BUILD, hook, str(target)]
        subprocess.run(command, cwd=folder / "source", check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def wheel(built):
    (path,) = built.glob("*-py3-none-any.whl")
    return zipfile.ZipFile(path)


def files(*patterns):
    found = {path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file()}
    return {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}


SOURCES = [f"airrace/**/*.{end}" for end in ("py", "sh", "html", "css", "js", "lcm")]


@pytest.mark.slow
def test_wheel_has_all_that_a_race_needs(wheel):
    names = set(wheel.namelist())
    assert files(*SOURCES, "airrace/py.typed") <= names
    assert {f"airrace/{name}" for name in files("models/**/*")} <= names


def test_it_races_without_a_checkout(built, wheel, tmp_path):
    """With the models, the machine code and the page of its own, and the command that pip makes."""
    place = tmp_path / "site-packages"
    wheel.extractall(place)
    (entry,) = (
        line.partition("=")[2].strip()
        for name in wheel.namelist()
        if name.endswith("entry_points.txt")
        for line in wheel.read(name).decode().splitlines()
        if line.startswith("airrace ")
    )
    module, function = entry.split(":")
    # What is compiled in the checkout is of the same sources.
    for folder in (ROOT / "airrace" / "__pycache__").glob("machine_code-*"):
        shutil.copytree(folder, place / "airrace" / "__pycache__" / folder.name)
    code = f"import sys, {module} as m, airrace; print(airrace.__file__); sys.exit(m.{function}())"
    options = [
        "--scenario_text",
        "{referee: {time_limit: 1.0}}",
        "--linger",
        "0",
        "--output",
        "out",
    ]
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, "race", *options],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(place)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1, done.stderr  # it runs out of time on its pad
    assert done.stdout.splitlines()[0] == str(place / "airrace" / "__init__.py")
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"race.json", "race.html", "race.mcap", "report.html"} <= left


def test_an_editable_install_uses_the_checkout(built, tmp_path):
    """`pip install -e`, as the lessons say: what is edited takes effect."""
    (wheel,) = (built / "editable").glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path)
    code = "import site, sys; site.addsitedir(sys.argv[1]); import airrace; print(airrace.__file__)"
    python = [sys.executable, "-I", "-S", "-c", code, str(tmp_path)]
    done = subprocess.run(python, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # models/ is found beside the package, see models_path().
    assert Path(done.stdout.strip()) == built / "source" / "airrace" / "__init__.py"


def test_source_distribution_has_all_that_a_wheel_is_made_of(built):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert files(*SOURCES, "airrace/py.typed", "models/**/*", "LICENSE", "pyproject.toml") <= names


def test_version_is_that_of_the_package(wheel):
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = Parser().parsestr(wheel.read(name).decode())
    assert metadata["Version"] == airrace.__version__


def test_page_of_an_index_shows_all_that_is_in_it(built, wheel):
    pytest.importorskip("twine", reason="twine is one of the dev dependencies")
    paths = [path for path in built.iterdir() if path.is_file()]
    command = [sys.executable, "-m", "twine", "check", "--strict", *paths]
    done = subprocess.run(command, capture_output=True, text=True)
    assert len(paths) == 2 and done.returncode == 0, done.stdout + done.stderr
    # Relative links and pictures would lead nowhere there.
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    text = Parser().parsestr(wheel.read(name).decode()).get_payload()
    links = text.split("](")[1:]
    assert "![" not in text and all(link.startswith("https://") for link in links)
