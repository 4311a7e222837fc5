"""The pages are built without a warning, and show what they should."""

import dataclasses as dc
import functools
import html
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import typing
import urllib.parse
from pathlib import Path

import pytest

from airrace.scenario import Scenario
from tests.visualization.browser import CHROMIUM, Browser
from tests.visualization.layout import check_page

ROOT = Path(__file__).parents[2]
GENERATED = shutil.ignore_patterns("api", "lessons", "examples")


def load(name):
    """Returns a module of docs/, which is no package."""
    pytest.importorskip("sphinx", reason="pip install '.[docs]'")
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def extension():
    return load("airrace_docs")


@pytest.fixture(scope="module")
def reference():
    return load("airrace_reference")


def build(folder):
    """Builds the pages in a folder, and returns where they are; nothing is written to the checkout.

    Without functions and classes in the tables of contents, which furo would copy for each of the
    hundreds of pages, and which no test looks at: they take longer than all the rest.
    """
    shutil.copytree(ROOT / "docs", folder / "docs", ignore=GENERATED)
    (folder / "airrace").symlink_to(ROOT / "airrace")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q"]
    command += ["-D", "toc_object_entries=0", folder / "docs", folder / "html"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-4000:]
    return folder / "html"


# One test: with more, several processes would each build the pages, which takes a minute.
@pytest.mark.repeats
def test_the_pages_are_built_and_show_what_they_should(extension, tmp_path):
    pages = build(tmp_path)
    every_module_has_its_place(pages, extension)
    the_season_has_its_ranking_and_its_page(pages)
    systems_are_drawn_with_their_ports(pages)
    every_field_of_a_scenario_is_there(pages)
    every_link_leads_somewhere(pages)
    lessons_and_examples_are_pages(pages)
    pages_hold_at_every_width(pages)


def pages_hold_at_every_width(pages):
    if CHROMIUM is not None:
        with Browser() as browser:
            names = "index", "own_systems", "benchmarks", "lessons/4_trajectories", "season/league"
            for name in names:
                check_page(browser, (pages / f"{name}.html").as_uri())


def every_link_leads_somewhere(pages):
    """Links and pictures within the site; those to others have the form of one."""
    for page in pages.rglob("*.html"):
        if "_modules" in page.parts:  # source, which links to itself
            continue
        for link in set(re.findall(r'(?:href|src)="([^"]+)"', page.read_text())):
            path, _, anchor = html.unescape(link).partition("#")
            if ":" in path or path.startswith("//"):
                assert re.match(r"(https?|data|mailto):", path), (page, link)
                continue
            target = page.parent / urllib.parse.unquote(path.partition("?")[0]) if path else page
            assert target.exists(), (page, link)
            if anchor and target.suffix == ".html":
                assert f'id="{anchor}"' in text_of(target), (page, link)


@functools.cache
def text_of(page):
    return page.read_text()


def lessons_and_examples_are_pages(pages):
    index = (pages / "index.html").read_text()
    assert 'href="lessons/index.html"' in index and 'href="examples/index.html"' in index
    for folder, source in (("lessons", "notebooks/*.ipynb"), ("examples", "examples/*.py")):
        for path in ROOT.glob(source):
            assert (pages / folder / f"{path.stem}.html").exists()
    assert "2026, airrace developers" in index
    ports = (pages / "own_systems.html").read_text()
    assert "<p>14</p>" in ports and "exploration_reference" in ports


def every_module_has_its_place(pages, extension):
    text = "".join(page.read_text() for page in (pages / "api").glob("*.html"))
    for name in extension.modules():
        assert f'id="module-{name}"' in text, name


def the_season_has_its_ranking_and_its_page(pages):
    text = (pages / "league.html").read_text()
    assert '<a href="season/league.html">' in text and "<p>20 of 20</p>" in text
    page = (pages / "season" / "league.html").read_text()
    assert "4 entries, 20\nraces each, level 2" in page and "touched pylon_6_left" in page


def systems_are_drawn_with_their_ports(pages):
    text = (pages / "api" / "airrace.systems.perception.html").read_text()
    assert '<th rowspan="3">ArucoDetector</th>' in text
    assert "<code>camera_view</code> &rarr;" in text and "&rarr; <code>detections</code>" in text


def every_field_of_a_scenario_is_there(pages):
    text = (pages / "scenario.html").read_text()
    for path, name in fields_of_a_scenario(Scenario):
        assert f">{name}</span></code>" in text, name
        assert not path or f">{path}</span></code>" in text, path


def fields_of_a_scenario(cls, path=""):
    """Yields every part of a scenario, by its path, and the names of its fields."""
    for name, hint in typing.get_type_hints(cls).items():
        yield path, name
        for part in (hint, *typing.get_args(hint)):
            if dc.is_dataclass(part):
                is_list = typing.get_origin(hint) is list
                yield from fields_of_a_scenario(part, f"{path}.{name}".strip(".") + "[]" * is_list)


def test_a_block_of_ports_is_read(extension):
    name, ports = extension.parse_system(
        [
            "name: Camera",
            "input_ports:",
            "- state",
            "- gate_shifts (only if gates move,",
            "  and so on)",
            "output_ports:",
            "- camera_view",
        ]
    )
    assert name == "Camera"
    assert ports == {
        "input_ports": ["state", "gate_shifts (only if gates move, and so on)"],
        "output_ports": ["camera_view"],
    }


def test_links_to_code_become_links_to_the_api(extension):
    source = ["[a.py](../airrace/track/rules.py), [b](../models/tracks/hexagon.yaml), [c](c.md)"]
    extension.link_code(None, "page", source)
    assert (
        source[0] == "{py:mod}`a.py <airrace.track.rules>`, `models/tracks/hexagon.yaml`, [c](c.md)"
    )


def test_links_to_lessons_and_examples_become_links_to_their_pages(extension):
    source = ["[2](../notebooks/2_a.ipynb), [c](../examples/c.py), [d](../examples/)"]
    extension.link_code(None, "page", source)
    assert source[0] == "[2](lessons/2_a.md), [c](examples/c.md), `examples/`"


def test_a_notebook_becomes_a_page(extension, tmp_path):
    cells = [
        ("markdown", "# A $x^2$ and [b](../docs/b.md#c)"),
        ("code", "x = 1"),
        ("code", "%time"),
    ]
    notebook = {"cells": [dict(cell_type=kind, source=[text]) for kind, text in cells]}
    (tmp_path / "a.ipynb").write_text(json.dumps(notebook))
    parts = extension.lesson_page(tmp_path / "a.ipynb").split("\n\n")
    assert parts[0] == "# A `x^2` and [b](../b.md#c)" and "`notebooks/a.ipynb`" in parts[1]
    assert parts[2:] == ["```python\nx = 1\n```", "```text\n%time\n```\n"]


def test_every_port_has_a_type_a_rate_and_a_meaning(reference):
    kinds, meanings = reference.port_kinds(), reference.port_meanings(Scenario())
    assert set(kinds) <= set(meanings)
    for name, (rate, given, meaning) in meanings.items():
        assert (kinds.get(name) or given) and meaning and (rate or name == "camera_info"), name
    assert "| `state_estimate` | 14 | 200 |" in reference.ports()


def test_formulas_stay_as_they_are(extension):
    lines = ["thrust c_f w^2, |v| v and 2 * x; ``a * b``", "", ".. block::", "", "    - a * b"]
    extension.plain_docstring(None, "function", "f", None, None, lines)
    assert lines[0] == r"thrust c_f w^2, \|v\| v and 2 \* x; ``a * b``"
    assert lines[4] == "    - a * b"


def test_every_field_of_a_scenario_has_a_meaning(reference):
    for line in reference.scenario_reference().splitlines():
        if line.startswith("| `") and line.count("|") == 6:
            *_, meaning, _ = line.split("|")
            assert meaning.strip(), line


def test_fields_are_read_with_their_comments(reference):
    part = reference.fields_of(Example)
    assert [field.name for field in part] == ["speed", "limits", "track", "seed"]
    assert [field.type for field in part] == ["float", "list[float] or null", "str", "int"]
    assert [field.comment for field in part] == ["m/s", "Not twice. Not once.", "a file", ""]
    assert [field.heading for field in part] == ["", "", "The world.", ""]


def test_the_table_of_systems_has_their_ports(reference):
    row = "| `rotor_monitor` | `rotor_status` | `rotor_losses` |"
    assert row in reference.systems()


@dc.dataclass
class Example:
    """A part of a scenario."""

    speed: float = 1.0  # m/s
    # Not twice.
    # Not once.
    limits: list[float] | None = None

    # The world.
    track: str = "a # b"  # a file
    seed: int = 0


def test_the_architecture_names_files_and_what_is_in_them():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+) \| `(.+)` \| `(.+)` \|$", text, re.M)
    assert len(rows) >= 15
    for behaviour, path, name in rows:
        source = (ROOT / "airrace" / path).read_text(encoding="utf-8")
        assert re.search(rf"^ *(def|class) {name}\b|^{name}\b.*=", source, re.M), behaviour
