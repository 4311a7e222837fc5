import subprocess
import sys

import pytest

from airrace.hitl.companion.arm_wheels import main, read_lock
from tests.hitl.companion.fake_checkout import ROOT, make_lock, make_wheel


@pytest.fixture
def index(tmp_path, monkeypatch):
    """A folder that is the only place where pip finds wheels."""
    folder = tmp_path / "index"
    folder.mkdir()
    for name in ("PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("COLUMNS", "200")
    return folder


def wheels(index, tags):
    """Makes wheels of a package for each tag of {name: [tag, ...]}; returns them."""
    return {
        name: [make_wheel(index, name, "1.0", {f"{name}.py": ""}, tag) for tag in its]
        for name, its in tags.items()
    }


def write_lock(path, made, marker=None):
    """Writes a lock of wheels, with the hashes of all of a package's."""
    lines = []
    for name, files in made.items():
        make_lock(path, files)
        hashes = " ".join(word for word in path.read_text().split() if word.startswith("--hash"))
        condition = f"; {marker[name]} " if name in (marker or {}) else ""
        lines.append(f"{name}==1.0 {condition}{hashes}")
    path.write_text("\n".join(lines) + "\n")


ARM = "cp312-cp312-manylinux_2_28_aarch64"
INTEL = "cp312-cp312-manylinux_2_28_x86_64"


def row(output, name):
    return next(line for line in output.splitlines() if f" {name} " in line)


def test_all_there(index, tmp_path, capsys):
    made = wheels(
        index,
        {
            "pure": ["py3-none-any"],
            "stable": ["cp37-abi3-manylinux2014_aarch64"],
            "compiled": [ARM, INTEL],
        },
    )
    write_lock(tmp_path / "lock", made)
    assert main(["--lock", str(tmp_path / "lock"), "--python", "3.12"]) == 0
    output = capsys.readouterr().out
    assert " any " in row(output, "pure")
    assert "abi3 manylinux2014" in row(output, "stable")
    assert "cp312 manylinux_2_28" in row(output, "compiled")


def test_missing_ones_are_named(index, tmp_path, capsys):
    made = wheels(
        index,
        {
            "pure": ["py3-none-any"],
            "intel": [INTEL],
            "young": ["cp312-cp312-manylinux_2_39_aarch64"],
            "old": ["cp311-cp311-manylinux_2_28_aarch64"],
            "muslc": ["cp312-cp312-musllinux_1_2_aarch64"],
            "elsewhere": [INTEL],
            "windows": ["cp312-cp312-win_amd64"],
        },
    )
    write_lock(
        tmp_path / "lock",
        made,
        {"elsewhere": "platform_machine != 'aarch64'", "windows": "sys_platform == 'win32'"},
    )
    assert main(["--lock", str(tmp_path / "lock"), "--python", "3.12"]) == 1
    output = capsys.readouterr().out
    assert "No wheel for aarch64: intel, muslc, old, young\n" in output
    assert "MISSING" in row(output, "intel") and "MISSING" not in row(output, "pure")
    assert "not needed" in row(output, "elsewhere") and "not needed" in row(output, "windows")


def test_pythons_are_told_apart(index, tmp_path, capsys):
    write_lock(tmp_path / "lock", wheels(index, {"compiled": [ARM]}))
    assert main(["--lock", str(tmp_path / "lock"), "--python", "3.12", "--python", "3.13"]) == 1
    assert row(capsys.readouterr().out, "compiled").count("MISSING") == 1


def test_wheels_of_other_contents_are_refused(index, tmp_path, capsys):
    made = wheels(index, {"pure": ["py3-none-any"]})
    write_lock(tmp_path / "lock", made)
    make_wheel(index, "pure", "1.0", {"pure.py": "import os"})
    assert main(["--lock", str(tmp_path / "lock"), "--python", "3.12"]) == 2
    assert "HASHES" in capsys.readouterr().err.upper()


def test_download(index, tmp_path, capsys):
    made = wheels(index, {"pure": ["py3-none-any"], "compiled": [ARM, INTEL]})
    write_lock(tmp_path / "lock", made)
    folder = tmp_path / "wheels"
    assert main(["--lock", str(tmp_path / "lock"), "--download", str(folder)]) == 0
    assert {path.name for path in folder.iterdir()} == {
        "pure-1.0-py3-none-any.whl",
        f"compiled-1.0-{ARM}.whl",
    }
    made["compiled"][0].unlink()
    assert main(["--lock", str(tmp_path / "lock"), "--download", str(folder / "2")]) == 2
    assert "compiled has no wheel" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["numpy\n", "numpy==1.0\n", "numpy>=1 --hash=sha256:0\n", "?!\n"])
def test_what_is_no_lock(text, tmp_path, capsys):
    (tmp_path / "lock").write_text(text)
    assert main(["--lock", str(tmp_path / "lock")]) == 2
    assert "no lock" in capsys.readouterr().err
    assert main(["--lock", str(tmp_path / "none")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_requirements_lock_is_read():
    pins = {pin.name: pin for pin in read_lock(ROOT / "requirements.lock")}
    assert pins["drake"].is_for("3.12") and pins["asyncssh"].is_for("3.14")
    assert not pins["mosek"].is_for("3.12")
    assert all(len(h) == 71 for h in pins["numpy"].hashes)


def test_help_teaches():
    done = subprocess.run(
        [sys.executable, "-m", "airrace.hitl.companion.arm_wheels", "--help"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0 and "--download wheels" in done.stdout
