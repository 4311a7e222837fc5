"""How long it takes from nothing to the first drone in the air, and to ten laps.

    python -m benchmarks.first_flight [--ways clone wheel uv container] [--json FILE]

Each way begins where a newcomer does, in a new folder, with caches that are empty:

  clone      ./run.bash in a fresh clone of what is committed here
  wheel      pip install of the wheel in a new environment, then airrace race
  uv         uv tool install of the wheel, then airrace race
  container  a race in the image of Containerfile, without a network; the time to
             build it is beside. It takes Docker or Podman

Packages come from wherever pip is told to get them. Nothing else should run meanwhile.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from airrace.common.errors import UserError
from benchmarks import harness

ROOT = Path(__file__).parents[1]
MOST = 90.0  # s, from nothing to the first drone in the air, in a clone
# What a race says when a stage is over. A race whose machine code is there compiles nothing.
STAGES = {"compiled_s": "CALIBRATE: ", "take_off_s": "TAKE_OFF: ", "laps_s": "Finished: "}
_UNSET = (
    *("NUMBA_CACHE_DIR", "PIP_CACHE_DIR", "PIP_NO_CACHE_DIR", "UV_CACHE_DIR", "PYTHONPATH"),
    *("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX", "VIRTUAL_ENV"),
)
_RACE = ("--linger", "0")
_IMAGE = "airrace:first-flight"


def main(argv=None) -> int:
    """Flies and prints the table; exit code 1 if a clone takes longer than the bound."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=["clone", "wheel", "uv"])
    parser.add_argument("--laps", type=harness.count, default=10, help="default: %(default)s")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list[dict]:
    """Returns a row for every way."""
    rows = []
    for way in args.ways:
        with tempfile.TemporaryDirectory(prefix="airrace-first-flight-") as folder:
            rows.append({"way": way, **WAYS[way](Path(folder), ("--laps", str(args.laps), *_RACE))})
    return rows


def clean_environment(folder: Path) -> dict[str, str]:
    """Returns the environment of this process, but for its caches: they are below a folder."""
    kept = {name: value for name, value in os.environ.items() if name not in _UNSET}
    caches = {"XDG_CACHE_HOME": str(folder / "cache"), "UV_TOOL_DIR": str(folder / "tools")}
    return kept | caches | {"UV_TOOL_BIN_DIR": str(folder / "bin")}


def stages(lines: Iterator[str], start: float, seen: dict[str, str] = STAGES) -> dict:
    """Returns when each stage was over (s); NaN for one that never was.

    Args:
        lines: of what a program prints, as it prints them.
        start: of time.perf_counter().
        seen: what a line holds when a stage is over.
    """
    times = dict.fromkeys(seen, float("nan"))
    for line in lines:
        for stage, words in seen.items():
            if words in line and times[stage] != times[stage]:
                times[stage] = time.perf_counter() - start
    return times


def _watched(command, folder: Path, start: float, seen: dict[str, str] = STAGES) -> dict:
    """Runs a race; returns its stages."""
    with subprocess.Popen(
        [str(word) for word in command],
        cwd=folder,
        env=clean_environment(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        said: list[str] = []

        def lines():
            for line in process.stdout:
                said.append(line)
                yield line

        times = stages(lines(), start, seen)
    if process.returncode:
        raise UserError(f"{command[0]} failed: {' '.join(''.join(said[-5:]).split())}.")
    return times


def _run(folder: Path, *command) -> None:
    words = [str(word) for word in command]
    done = subprocess.run(
        words, cwd=folder, env=clean_environment(folder), capture_output=True, text=True
    )
    if done.returncode:
        last = " ".join((done.stdout + done.stderr).split()[-60:])
        raise UserError(f"{' '.join(words)} failed: {last}.")


def fly_in_a_clone(folder: Path, options: tuple[str, ...]) -> dict:
    """Returns the stages of ./run.bash."""
    _run(folder, "git", "clone", "--quiet", ROOT, folder / "clone")
    start = time.perf_counter()
    return _watched(
        [folder / "clone" / "run.bash", *options],
        folder,
        start,
        {"installed_s": "airrace: ready.", **STAGES},
    )


def _make_wheel(folder: Path) -> Path:
    _run(folder, "git", "clone", "--quiet", ROOT, folder / "source")
    pip = sys.executable, "-I", "-m", "pip", "wheel", "--quiet", "--no-deps"
    _run(folder, *pip, "--no-build-isolation", "--wheel-dir", folder / "dist", folder / "source")
    shutil.rmtree(folder / "source")  # so that nothing can be found there
    (wheel,) = (folder / "dist").glob("*.whl")
    return wheel


def fly_from_a_wheel(folder: Path, options: tuple[str, ...]) -> dict:
    """Returns the stages of pip install, and a race without a checkout."""
    wheel = _make_wheel(folder)
    start = time.perf_counter()
    _run(folder, sys.executable, "-I", "-m", "venv", folder / "environment")
    programs = folder / "environment" / "bin"
    _run(folder, programs / "python", "-I", "-m", "pip", "install", "--quiet", wheel)
    return _race_installed(programs / "airrace", folder, options, start)


def fly_as_a_tool_of_uv(folder: Path, options: tuple[str, ...]) -> dict:
    """Returns the stages of uv tool install, and a race without a checkout."""
    wheel = _make_wheel(folder)
    beside = Path(sys.executable).parent / "uv"  # run.bash puts one there
    uv = beside if beside.is_file() else shutil.which("uv")
    if uv is None:
        raise UserError("There is no uv: install it, or leave the way uv out.")
    start = time.perf_counter()
    _run(folder, uv, "tool", "install", "--quiet", "--python", sys.executable, wheel)
    return _race_installed(folder / "bin" / "airrace", folder, options, start)


def _race_installed(program, folder, options, start):
    installed = time.perf_counter() - start
    return {"installed_s": installed, **_watched([program, "race", *options], folder, start)}


def fly_in_a_container(folder: Path, options: tuple[str, ...]) -> dict:
    """Returns the stages of a race in the image of Containerfile, and how long that took."""
    engine = shutil.which("podman") or shutil.which("docker")
    if engine is None:
        raise UserError("There is neither Podman nor Docker: leave the way container out.")
    _run(folder, "git", "clone", "--quiet", ROOT, folder / "source")
    start = time.perf_counter()
    build = engine, "build", "--quiet", "--no-cache", "--file", "Containerfile"
    _run(folder, *build, "--tag", _IMAGE, folder / "source")
    built = time.perf_counter() - start
    start = time.perf_counter()
    run = engine, "run", "--rm", "--network", "none", "--read-only", "--tmpfs", "/tmp"
    times = _watched([*run, _IMAGE, "race", "--output", "/tmp/race", *options], folder, start)
    return {"installed_s": 0.0, "built_s": built, **times}


WAYS = {
    "clone": fly_in_a_clone,
    "wheel": fly_from_a_wheel,
    "uv": fly_as_a_tool_of_uv,
    "container": fly_in_a_container,
}


def show(rows: list[dict]) -> tuple[list, bool]:
    """Returns the table, and whether a clone is quick enough."""
    columns = {
        "way": "{way}",
        "image built": lambda row: f"{row['built_s']:.0f} s" if row["built_s"] else "-",
        "installed": "{installed_s:.0f} s",
        "compiled": "{compiled_s:.0f} s",
        "first drone in the air": "{take_off_s:.0f} s",
        "all laps flown": "{laps_s:.0f} s",
    }
    title = f"From nothing to a race, since the start (bound for a clone: {MOST:.0f} s in the air)"
    rows = [{"built_s": None, **row} for row in rows]
    table = harness.make_table(title, rows, columns)
    return [table], all(row["take_off_s"] <= MOST for row in rows if row["way"] == "clone")


if __name__ == "__main__":
    sys.exit(main())
