"""The API pages are built without a warning, and show what they should."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def extension():
    pytest.importorskip("sphinx", reason="pip install '.[docs]'")
    spec = importlib.util.spec_from_file_location("airrace_docs", ROOT / "docs/airrace_docs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def pages(extension, tmp_path_factory):
    """The built pages; nothing is written to the checkout."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(ROOT / "docs", folder / "docs", ignore=shutil.ignore_patterns("api"))
    conf = folder / "docs" / "conf.py"
    conf.write_text(conf.read_text().replace("_HERE.parent", repr(str(ROOT))))
    build = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            "-W",
            "--keep-going",
            "-q",
            folder / "docs",
            folder / "html",
        ],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert build.returncode == 0, build.stderr[-4000:]
    return folder / "html"


@pytest.mark.slow
def test_every_module_has_its_place(pages, extension):
    text = "".join(page.read_text() for page in (pages / "api").glob("*.html"))
    for name in extension.modules():
        assert f'id="module-{name}"' in text, name


@pytest.mark.slow
def test_systems_are_drawn_with_their_ports(pages):
    text = (pages / "api" / "airrace.systems.perception.html").read_text()
    assert '<th rowspan="3">ArucoDetector</th>' in text
    assert "<code>camera_view</code> &rarr;" in text and "&rarr; <code>detections</code>" in text


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


def test_formulas_stay_as_they_are(extension):
    lines = ["thrust c_f w^2, |v| v and 2 * x; ``a * b``", "", ".. block::", "", "    - a * b"]
    extension.plain_docstring(None, "function", "f", None, None, lines)
    assert lines[0] == r"thrust c_f w^2, \|v\| v and 2 \* x; ``a * b``"
    assert lines[4] == "    - a * b"


def test_the_architecture_names_files_and_what_is_in_them():
    text = (ROOT / "docs" / "architecture.rst").read_text(encoding="utf-8")
    rows = re.findall(r"\* - (.+)\n     - ``(.+)``\n     - ``(.+)``", text)
    assert len(rows) >= 15
    for behaviour, path, name in rows:
        source = (ROOT / "airrace" / path).read_text(encoding="utf-8")
        assert re.search(rf"^ *(def|class) {name}\b|^{name}\b.*=", source, re.M), behaviour
