"""What a race needs of this computer, and whether it is there."""

import importlib
import platform
import shutil
from collections.abc import Iterator

import numba

from airrace.common import jit
from airrace.common.errors import UserError, words
from airrace.common.processes import processors, real_time_priority
from airrace.common.resources import PACKAGE
from airrace.common.version import VERSION
from airrace.hitl.link.doctor import BAD, GOOD, WEAK, Row
from airrace.scenario import TRUTH

_FREE = 1.0  # GB, for results; ten laps take 22 MB
_WRITTEN = 0.2  # GB, less and a race may not fit
_PACE = 5.0  # times real time, of a firmware that shares the time with all others
_IN_TIME = 0.99  # of its steps
_CORES = 2  # two processes share the work in HITL
_PACKAGES = ("pydrake", "cv2", "numba", "scipy", "pandas", "distributed", "foxglove")


def check_computer() -> list[Row]:
    """Returns the rows of the doctor's table."""
    return [
        Row("airrace", f"{VERSION}, in {PACKAGE}", "any", GOOD, ""),
        Row("Python", platform.python_version(), "3.12 or newer", GOOD, ""),
        *(_package(name) for name in _PACKAGES),
        _vtk(),
        *_betaflight(),
        _machine_code(),
        _cores(),
        _priority(),
        _disk(),
    ]


def _package(name: str) -> Row:
    try:
        module = importlib.import_module(name)
    except ImportError as e:
        remedy = f"install airrace's packages again, or the system library: {words(e)}"
        return Row(name, "cannot be imported", "can be imported", BAD, remedy)
    return Row(name, str(getattr(module, "__version__", "there")), "can be imported", GOOD, "")


def _vtk() -> Row:
    from airrace.rendering.vtk.vtk_renderer import check_vtk_available

    try:
        check_vtk_available()
    except UserError as e:
        return Row("--renderer vtk", "no", "only if you want it", WEAK, str(e))
    return Row("--renderer vtk", "yes", "only if you want it", GOOD, "")


def _betaflight() -> Iterator[Row]:
    from airrace.betaflight.firmware import find_firmware
    from airrace.betaflight.firmware_process import PERIOD, measure_pace

    what, needed = "Betaflight", "only if you want it"
    try:
        firmware = find_firmware()
        yield Row(what, f"{firmware.version}, in {firmware.program.parent}", needed, GOOD, "")
        pace = measure_pace(firmware)
    except UserError as e:
        yield Row(what, "no", needed, WEAK, str(e))
        return
    times = PERIOD * pace.steps
    remedy = "end other programs: races with it are slow" if times < _PACE else ""
    status = WEAK if remedy else GOOD
    yield Row("Betaflight alone", f"{times:.1f} x real time", f"{_PACE:g} x", status, remedy)
    found = f"{pace.in_time:.1%} of steps in time, 99 % within {1e3 * pace.p99:.2f} ms"
    remedy = "end other programs: in real time, races with it fall behind, and catch up"
    status, remedy = (GOOD, "") if pace.in_time >= _IN_TIME else (WEAK, remedy)
    yield Row("Betaflight in real time", found, f"{_IN_TIME:.0%} in 1 ms", status, remedy)


def _machine_code() -> Row:
    what = "inner loops compiled"
    folder = numba.config.CACHE_DIR
    if jit.is_complete(TRUTH):
        return Row(what, f"yes, in {folder}", "before the first race", GOOD, "")
    remedy = f"nothing: the first race compiles them into {folder}, which takes a minute"
    return Row(what, "no", "before the first race", WEAK, remedy)


def _cores() -> Row:
    cores = processors()
    needed = f"{_CORES} for HITL"
    if cores >= _CORES:
        return Row("processors", str(cores), needed, GOOD, "")
    remedy = "HITL: race with --realtime_rate 0.5 or --lockstep"
    return Row("processors", str(cores), needed, WEAK, remedy)


def _priority() -> Row:
    what, needed = "real-time priority", "only for the pilot in HITL"
    with real_time_priority() as granted:
        pass
    if granted:
        return Row(what, "yes", needed, GOOD, "")
    remedy = "docs/board.md says how to grant it; without it commands may come some ms later"
    return Row(what, "no", needed, WEAK, remedy)


def _disk() -> Row:
    free = shutil.disk_usage(".").free / 1e9
    verdict = GOOD if free >= _FREE else WEAK if free >= _WRITTEN else BAD
    remedy = "" if verdict == GOOD else "make room, or race with --record light"
    return Row("free disk here", f"{free:.1f} GB", f"≥ {_FREE:.0f} GB", verdict, remedy)
