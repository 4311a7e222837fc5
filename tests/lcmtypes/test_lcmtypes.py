"""The committed classes are what lcm-gen makes of the .lcm files."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import airrace.lcmtypes

FOLDER = Path(airrace.lcmtypes.__file__).parent
LCM_GEN = shutil.which("lcm-gen", path=str(Path(sys.executable).parent)) or shutil.which("lcm-gen")


@pytest.mark.skipif(LCM_GEN is None, reason="there is no lcm-gen, which comes with lcm")
def test_regenerated_code_is_the_same(tmp_path):
    types = sorted(FOLDER.glob("*.lcm"))
    assert len(types) > 10
    subprocess.run([LCM_GEN, "--python", "--ppath", str(tmp_path), *map(str, types)], check=True)
    generated = {path.name: path.read_text() for path in (tmp_path / "airrace/lcmtypes").iterdir()}
    committed = {path.name: path.read_text() for path in FOLDER.glob("*.py")}
    assert generated == committed


def test_a_type_that_changes_has_another_fingerprint():
    """So that both sides notice if one of them is of another version."""
    fingerprints = {
        name: getattr(airrace.lcmtypes, name)._get_packed_fingerprint()
        for name in dir(airrace.lcmtypes)
        if name.startswith("lcmt_") and isinstance(getattr(airrace.lcmtypes, name), type)
    }
    assert len(set(fingerprints.values())) == len(fingerprints) > 10
