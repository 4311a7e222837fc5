"""Files beside the code that tools and people read: they parse, and agree with the code."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

import airrace

ROOT = Path(__file__).parents[1]


def load(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def load_pyproject():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_there_is_one_version():
    project = load_pyproject()
    assert "version" in project["project"]["dynamic"] and "version" not in project["project"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {
        "attr": "airrace.common.version.VERSION"
    }
    assert load("CITATION.cff")["version"] == airrace.__version__
    assert f"## [{airrace.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_citation_has_what_its_format_wants():
    citation = load("CITATION.cff")
    project = load_pyproject()["project"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    assert citation["authors"] == project["authors"]
    assert citation["license"] == project["license"]


def test_the_workflow_runs_the_tests():
    (job,) = load(".github/workflows/test.yml")["jobs"].values()
    assert job["steps"][-1]["run"].startswith("./test.bash ")


def test_hooks_before_a_commit_need_no_network():
    (repository,) = load(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"
    for hook in repository["hooks"]:
        assert hook["language"] == "system" and hook["entry"].startswith(".venv/bin/")


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "CHANGELOG.md"])
def test_what_is_named_is_there(name):
    """Paths in links and in code that begin with a folder of the checkout."""
    text = (ROOT / name).read_text(encoding="utf-8")
    links = [part.partition(")")[0].partition("#")[0] for part in text.split("](")[1:]]
    code = [word for part in text.split("`")[1::2] for word in part.split()]
    folders = ("airrace/", "models/", "tests/", "tools/", "./")
    named = [link for link in links if not link.startswith("https:")]
    named += [word for word in code if word.startswith(folders)]
    assert all((ROOT / path).exists() for path in named)


def test_every_extra_that_is_named_is_there():
    """What pip does not know, it only warns of, and installs nothing."""
    extras = load_pyproject()["project"]["optional-dependencies"]
    folders = [ROOT / name for name in ("airrace", "benchmarks", "docs", "examples", "notebooks")]
    files = [*ROOT.glob("*.md"), *(path for folder in folders for path in folder.rglob("*.*"))]
    named = {
        name
        for path in files
        if path.suffix in (".ipynb", ".md", ".py")
        for names in re.findall(r"install [^\n]*\[([a-z,]+)\]", path.read_text(encoding="utf-8"))
        for name in names.split(",")
    }
    assert {"train", "rl"} <= named <= extras.keys()
