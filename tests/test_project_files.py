"""Files beside the code that tools and people read: they parse, and agree with the code."""

import json
import os
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import airrace
from airrace.visualization import loopback_server

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


WORKFLOWS = ["test.yml", "release.yml"]


def jobs(workflow):
    return load(f".github/workflows/{workflow}")["jobs"]


def commands(job):
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_workflow_runs_the_tests_on_every_system():
    tests = jobs("test.yml")
    assert commands(tests["test"])[-1].startswith("./test.bash ")
    for name in ("macos", "wsl2"):
        race, quick = commands(tests[name])[-2:]
        assert "./run.bash --track" in race and './test.bash -m "not slow' in quick
    build, race = commands(tests["container"])
    assert "--file Containerfile" in build and "--network none --read-only" in race


@pytest.mark.parametrize("workflow", WORKFLOWS)
def test_actions_have_a_version_and_jobs_an_end(workflow):
    for job in jobs(workflow).values():
        assert job["timeout-minutes"] <= 60
        for action in (step["uses"] for step in job["steps"] if "uses" in step):
            assert re.fullmatch(r"[\w-]+/[\w-]+@(v\d+|release/v\d+)", action), action
    assert load(f".github/workflows/{workflow}")["permissions"] == {"contents": "read"}


def test_a_release_is_checked_tried_and_attested_before_it_is_published():
    release = jobs("release.yml")
    assert release["race"]["needs"] == "build" and release["publish"]["needs"] == "race"
    assert any("twine check --strict" in command for command in commands(release["build"]))
    # Nothing of the checkout is there to be used instead of the wheel's own.
    race = [step.get("uses", "") for step in release["race"]["steps"]]
    assert not any(action.startswith("actions/checkout") for action in race)
    assert any(command.startswith("airrace race ") for command in commands(release["race"]))
    uses = [step["uses"] for step in release["publish"]["steps"] if "uses" in step]
    attests, publishes = (
        next(i for i, action in enumerate(uses) if name in action)
        for name in ("attest-build-provenance", "gh-action-pypi-publish")
    )
    assert attests < publishes
    # Trusted publishing: no secret but what the run itself is given.
    text = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    assert release["publish"]["permissions"]["id-token"] == "write" and "secrets." not in text


def test_the_image_is_made_of_what_is_here_and_races_without_root():
    text = (ROOT / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    steps = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
    sent = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert [words[1].endswith("-slim") for words in steps if words[0] == "FROM"] == [True, True]
    for words in steps:
        if words[0] == "COPY" and not words[1].startswith("--from"):
            for name in words[1:-1]:
                assert (ROOT / name).exists() and f"!{name}" in sent
    assert [words for words in steps if words[0] == "USER"] == [["USER", "1000:1000"]]
    assert not [words for words in steps if words[0] == "ADD"]
    assert os.access(ROOT / "tools/in_container.sh", os.X_OK)


def test_what_is_developed_in_a_container_is_set_up_by_our_own_script():
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text(encoding="utf-8"))
    assert container["updateContentCommand"].startswith("./test.bash")
    assert container["forwardPorts"] == [loopback_server._PORTS[0]]


def test_every_extra_is_in_the_table_of_the_documentation():
    """With no other packages than pip would install."""
    text = (ROOT / "docs/install.md").read_text(encoding="utf-8")
    table = text.partition("| extra |")[2].partition("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in table]
    named = {name.strip("`"): set(re.findall(r"`([\w.-]+)`", last)) for name, *_, last in cells}
    extras = load_pyproject()["project"]["optional-dependencies"]
    packages = {name: {Requirement(text).name for text in texts} for name, texts in extras.items()}
    packages["dev"] = named.get("dev")  # two dozens, which nobody reads
    assert named == packages


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
