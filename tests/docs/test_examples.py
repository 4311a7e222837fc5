"""The examples of README.md and docs/ do what they say."""

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys

import pytest
import yaml
from cyclopts import CycloptsError

from airrace.commands.app import make_app
from airrace.scenario import load_scenario
from tests.docs.pages import PAGES, ROOT, blocks, console_commands, same_line, same_lines

SHELL = blocks("sh")
PYTHON = blocks("python")
CONSOLE = blocks("console")
WITH_OUTPUT = sorted({block.page for block in CONSOLE})
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_INLINE = re.compile(r"`((?:airrace|\./run\.bash) [^`]+)`")


def test_the_readme_is_a_front_page():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 200


@pytest.mark.repeats
@pytest.mark.parametrize("page", WITH_OUTPUT, ids=lambda page: page.name)
def test_commands_print_what_the_page_says(page, tmp_path):
    write_stubs(tmp_path)
    for block in PYTHON:
        if block.page == page and block.note.startswith("file: "):
            (tmp_path / block.note.removeprefix("file: ")).write_text(block.text)
    for block in (block for block in CONSOLE if block.page == page):
        for command, expected in console_commands(block):
            done = run(command, tmp_path)
            assert done.returncode == 0, f"{block}: {command}\n{done.stdout}"
            typed = done.stdout.replace(f"{sys.executable} -m airrace", "airrace")
            # On a terminal, something turns in the place of such a line.
            lines = typed.splitlines()
            actual = [line for line in lines if not re.match(r"[A-Z]\w+ing .*\.\.\.$", line)]
            assert same_lines(expected, actual, block.tolerance), f"{block}\n{done.stdout}"


def write_stubs(folder):
    """Makes what the commands of the pages call: of this checkout, and by this Python."""
    (folder / "bin").mkdir()
    for path, words in {"bin/airrace": "-m airrace", "run.bash": "-m airrace race"}.items():
        (folder / path).write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        (folder / path).chmod(0o755)


def run(command, folder):
    """Runs a command of a page in a folder; returns what it prints, errors included."""
    environment = {
        **os.environ,
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "COLUMNS": "80",
    }
    return subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=600,
    )


@pytest.mark.slow
@pytest.mark.parametrize("block", SHELL, ids=str)
def test_commands_that_are_not_run_exist(block):
    checked = subprocess.run(["bash", "-n"], input=block.text, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stderr
    text = re.sub(r"\\\n|\n {2,}", " ", block.text)  # a line that goes on is one command
    for line in text.splitlines():
        line = re.sub(r"^[A-Z_]+=\S+ ", "", line)  # of the environment
        if words := shlex.split(line, comments=True):
            check_command(words)


def check_command(words):
    """Raises unless a command of ours exists and has these options."""
    program, *rest = words
    if program.endswith("python") and rest[:1] == ["-m"]:
        program, rest = rest[1], rest[2:]
    if program == "./run.bash":
        program, rest = "airrace", ["race", *rest]
    if program == "airrace":
        make_app().parse_args(rest, exit_on_error=False, print_error=False)
    elif program == "./test.bash":
        assert all((ROOT / word).exists() for word in rest if word.startswith("tests/"))
    elif program.startswith("benchmarks."):
        help = subprocess.run(
            [sys.executable, "-m", program, "--help"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert help.returncode == 0, help.stderr
        for word in rest:
            assert not word.startswith("-") or re.search(rf"^ +{word}\b", help.stdout, re.M), word


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_the_text_exist(page):
    for command in _INLINE.findall(page.read_text(encoding="utf-8")):
        program, *rest = command.split()
        rest = ["race", *rest] if program == "./run.bash" else rest
        app = make_app()
        for word in rest:
            if word.startswith("-"):
                names = [name for each in arguments(app) for name in each.names]
                assert word in (*names, "--help", "--version"), command
            elif word in app:
                app = app[word]
            elif word not in ("...", "RUN...") and app.default_command is None:
                raise AssertionError(f"{command}: there is no {word}")


def arguments(app):
    """Returns the options of a subcommand."""
    parameter = make_app().default_parameter
    return app.assemble_argument_collection(default_parameter=parameter)


@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_python_compiles_and_imports_what_there_is(block):
    tree = ast.parse(block.text)
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {each.name: importlib.import_module(each.name) for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, each.name) for each in node.names), ast.unparse(node)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            assert module is None or hasattr(module, node.attr), ast.unparse(node)


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_yaml_can_be_read(block):
    assert yaml.safe_load(block.text)


@pytest.mark.parametrize(
    "block", [each for each in blocks("yaml") if each.page.name == "scenario.md"], ids=str
)
def test_a_scenario_can_be_loaded(block, tmp_path):
    (tmp_path / "mine.yaml").write_text(block.text)
    load_scenario(filename=str(tmp_path / "mine.yaml")).check()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page):
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        path, _, heading = link.partition("#")
        if "://" in link:
            assert re.fullmatch(r"(https|http://localhost|ssh)[:/]\S+", link), (
                f"{page.name}: {link}"
            )
            continue
        if path in ("api/index.rst", "lessons/index.md", "examples/index.md"):  # written by Sphinx
            continue
        target = page.parent / path if path else page
        assert target.exists(), f"{page.name}: {link}"
        assert not heading or heading in headings(target), f"{page.name}: {link}"


def test_the_site_calls_its_pages_by_their_titles():
    """Links of the front page, and so what a reader looks for in the column beside it."""
    index = ROOT / "docs" / "index.md"
    links = re.findall(r"\[([^\]]+)\]\((\w+\.md)\)", index.read_text(encoding="utf-8"))
    assert len(links) > 20
    for text, page in links:
        title = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()[0]
        assert title == f"# {text}", page


@pytest.mark.parametrize("path", [*NOTEBOOKS, *EXAMPLES], ids=lambda path: path.name)
def test_lessons_and_examples_name_files_that_there_are(path):
    text = path.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([\w./]+\.(?:md|ipynb|py|yaml))[)#]", text):
        assert (path.parent / link).exists(), link
    for named in re.findall(r"\b(?:docs|models|airrace)/[\w/]+\.(?:md|py|yaml)\b", text):
        assert (ROOT / named).exists(), named


def headings(page):
    """Returns what links call the headings of a page."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


def test_every_block_has_a_language_that_is_checked():
    known = ("", "sh", "console", "python", "yaml", "{toctree}")
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    fences = re.findall(r"^ *```(.*)$", text, re.M)
    assert set(fences) <= set(known)


def test_outputs_are_compared_line_by_line():
    assert same_lines(["a", "...", "b"], ["a", "x", "y", "b"], 0.0)
    assert same_lines(["...", "b"], ["b"], 0.0)
    assert not same_lines(["a", "...", "b"], ["a", "x"], 0.0)
    assert not same_lines(["a"], ["a", "b"], 0.0)


def test_figures_are_compared_within_a_tolerance():
    assert same_line("lap 1: 9.44 s", "lap  1: 9.50 s", 0.02)
    assert not same_line("lap 1: 9.44 s", "lap 1: 9.80 s", 0.02)
    assert not same_line("lap 1: 9.44 s", "lap 2: 9.44 s", 0.02)
    assert not same_line("lap 1: 9.44 s", "lap 1: 9.45 s", 0.0)
    assert same_line("best 9.44 s; ...", "best 9.44 s; 19 s of work", 0.0)
    assert same_line("offset 0.0 degrees", "offset 0.1 degrees", 0.02)


def test_a_wrong_option_is_found():
    with pytest.raises(CycloptsError):
        check_command(["airrace", "race", "--lap", "3"])
    with pytest.raises(CycloptsError):
        check_command(["./run.bash", "-t", "5"])
