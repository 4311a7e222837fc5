"""The way of docs/board.md to bring the wheels along for a board without the internet."""

import json
import shlex
import subprocess
import sys

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from airrace.hitl.companion.set_up import LOCK
from tests.hitl.companion.fake_checkout import ROOT


def pip(*words):
    command = [sys.executable, "-m", "pip", *words, "--quiet", "--no-input"]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=1200)


def download_command():
    """Returns the words of the page's command after ``pip download``."""
    text = (ROOT / "docs" / "board.md").read_text(encoding="utf-8").replace("\\\n", " ")
    (line,) = (line for line in text.splitlines() if " -m pip download " in line)
    return shlex.split(line.partition(" -m pip download ")[2])


@pytest.mark.repeats
def test_every_locked_package_has_a_wheel_for_the_board(tmp_path):
    words = download_command()
    python = words[words.index("--python-version") + 1]
    if python != f"{sys.version_info.major}.{sys.version_info.minor}":
        pytest.skip(f"pip judges the lock's markers by its own Python, and this is not {python}")
    if pip("download", "--no-deps", "--dest", str(tmp_path), "iniconfig").returncode:
        pytest.skip("there is no package index")
    at = words.index("-d")
    del words[at : at + 2]
    report = tmp_path / "report.json"
    target = ["--dry-run", "--ignore-installed", "--target", str(tmp_path / "target")]
    done = pip("install", *target, "--report", str(report), *words)
    assert done.returncode == 0, done.stderr[-3000:]
    found = {
        canonicalize_name(item["metadata"]["name"])
        for item in json.loads(report.read_text(encoding="utf-8"))["install"]
    }
    lock = (ROOT / LOCK).read_text(encoding="utf-8").replace("\\\n", " ")
    locked = [
        Requirement(line.partition(" --hash")[0])
        for line in lock.splitlines()
        if line.strip() and line[0] not in " #"
    ]
    needed = {canonicalize_name(r.name) for r in locked if not r.marker or r.marker.evaluate()}
    assert found == needed and len(found) > 50
