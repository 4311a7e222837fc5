"""Checks that every locked package has a wheel for 64-bit Arm, or downloads them."""

import argparse
import dataclasses
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import parse_wheel_filename
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from airrace.common.errors import UserError, exit_code
from airrace.hitl.companion.wheel import checkout_path

PYTHONS = ("3.12", "3.13", "3.14")
_GLIBC = (17, 34)  # 2.17 to 2.34, with which Drake's wheels begin
_MACHINE = "aarch64"
_EPILOG = """\
It asks the package index that pip is set to (pip config list). For a companion
without the internet:

  python -m airrace.hitl.companion.arm_wheels --download wheels
  ./run.bash -s HITL --companion user@host --wheels wheels

Exit codes: 0 all there, 1 a wheel is missing, 2 bad input.
"""


@dataclasses.dataclass(frozen=True)
class Pin:
    """A package of a lock.

    Attributes:
        requirement: with one exact version, and perhaps a marker.
        hashes: as pip writes them, "sha256:...".
    """

    requirement: Requirement
    hashes: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of the package."""
        return self.requirement.name

    @property
    def version(self) -> str:
        """Of the package."""
        return next(iter(self.requirement.specifier)).version

    def is_for(self, python: str) -> bool:
        """Whether the package is installed on 64-bit Arm under Linux, for a Python "3.x"."""
        environment = {
            "platform_machine": _MACHINE,
            "platform_system": "Linux",
            "sys_platform": "linux",
            "os_name": "posix",
            "implementation_name": "cpython",
            "platform_python_implementation": "CPython",
            "python_version": python,
            "python_full_version": f"{python}.0",
        }
        marker = self.requirement.marker
        return marker is None or marker.evaluate(environment)

    @property
    def line(self) -> str:
        """For a requirements file, without the marker."""
        hashes = " ".join(f"--hash={h}" for h in self.hashes)
        return f"{self.name}=={self.version} {hashes}\n"


def read_lock(path: Path) -> list[Pin]:
    """Returns the packages of a lock.

    Raises:
        UserError: if it cannot be read.
    """
    pins = []
    try:
        for line in path.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
            requirement, *hashes = line.partition("#")[0].split("--hash=")
            if requirement.strip():
                pin = Pin(Requirement(requirement), tuple(h.strip() for h in hashes))
                if [s.operator for s in pin.requirement.specifier] != ["=="] or not hashes:
                    raise ValueError("neither pinned nor hashed")
                pins.append(pin)
    except OSError as e:
        raise UserError(
            f"--lock {path} cannot be read ({e.strerror}); name another file."
        ) from None
    except ValueError:
        raise UserError(
            f"--lock {path} is no lock with hashes; make one with tools/lock.bash."
        ) from None
    return pins


def find_wheels(pins: list[Pin], python: str, pip=(sys.executable, "-m", "pip")) -> dict:
    """Returns the file name of the wheel that pip would install there, by package.

    Packages without one are not among them.

    Args:
        pins: the packages.
        python: of the companion, "3.x".
        pip: the command that pip is.

    Raises:
        UserError: if pip fails for another reason.
    """
    wanted = {pin.name: pin for pin in pins if pin.is_for(python)}
    with tempfile.TemporaryDirectory(prefix="airrace-") as folder:
        report = Path(folder) / "report.json"
        while wanted:
            missing = _pip(
                [
                    *pip,
                    "install",
                    "--dry-run",
                    "--ignore-installed",
                    "--quiet",
                    "--report",
                    str(report),
                    "--target",
                    folder,
                ],
                wanted,
                python,
                folder,
            )
            if missing is None:
                items = json.loads(report.read_text(encoding="utf-8"))["install"]
                urls = [item["download_info"]["url"] for item in items]
                return {
                    re.sub(r"[-_.]+", "-", item["metadata"]["name"]).lower(): url.partition("#")[0]
                    .rpartition("/")[2]
                    .replace("%2B", "+")
                    for item, url in zip(items, urls)
                }
            del wanted[missing]
    return {}


def download(pins: list[Pin], python: str, folder: Path, pip=(sys.executable, "-m", "pip")) -> None:
    """Downloads the wheels into a folder. Arguments and errors: as find_wheels()."""
    wanted = {pin.name: pin for pin in pins if pin.is_for(python)}
    with tempfile.TemporaryDirectory(prefix="airrace-") as scratch:
        missing = _pip(
            [*pip, "download", "--quiet", "--dest", str(folder)], wanted, python, scratch
        )
    if missing is not None:
        raise UserError(
            f"{missing} has no wheel for {_MACHINE} and Python {python}; see "
            "'python -m airrace.hitl.companion.arm_wheels'."
        )


def _pip(command, wanted, python, folder) -> str | None:
    """Runs pip; returns the name of a package without a wheel, None if all have one."""
    lock = Path(folder) / "requirements.txt"
    lock.write_text("".join(pin.line for pin in wanted.values()), encoding="utf-8")
    platforms = [f"manylinux_2_{n}_{_MACHINE}" for n in range(_GLIBC[1], _GLIBC[0] - 1, -1)]
    done = subprocess.run(
        [
            *command,
            "--no-deps",
            "--only-binary",
            ":all:",
            "--require-hashes",
            "--no-input",
            "--disable-pip-version-check",
            "--implementation",
            "cp",
            "--python-version",
            python,
            *(
                word
                for name in (*platforms, f"manylinux2014_{_MACHINE}")
                for word in ("--platform", name)
            ),
            "--requirement",
            str(lock),
        ],
        capture_output=True,
        text=True,
        errors="replace",
        stdin=subprocess.DEVNULL,
    )
    if done.returncode == 0:
        return None
    match = re.search(r"No matching distribution found for ([\w.-]+)==", done.stderr)
    if match and match[1] in wanted:
        return match[1]
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    reason = (errors or ["ERROR: it does not say why"])[-1].removeprefix("ERROR: ")[:300]
    raise UserError(
        f"pip cannot look for the wheels ({reason.rstrip('.')}); see that "
        "'pip download drake' works."
    )


def make_table(pins: list[Pin], found: dict[str, dict]) -> Table:
    """Returns the table of what was found: Python to package to file name."""
    table = Table()
    table.add_column("package")
    table.add_column("version")
    for python in found:
        table.add_column(f"Python {python}")
    for pin in pins:
        cells = [_cell(pin, python, names) for python, names in found.items()]
        table.add_row(pin.name, pin.version, *cells)
    return table


def _cell(pin, python, names) -> str:
    if not pin.is_for(python):
        return "not needed"
    if pin.name not in names:
        return "[red]MISSING[/red]"
    tags = parse_wheel_filename(names[pin.name])[3]
    if any(tag.platform == "any" for tag in tags):
        return "any"
    tag = min(tags, key=lambda tag: [int(n) for n in re.findall(r"\d+", tag.platform)][:2])
    return f"{tag.abi if tag.abi == 'abi3' else tag.interpreter} " + tag.platform.removesuffix(
        f"_{_MACHINE}"
    )


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m airrace.hitl.companion.arm_wheels",
        description=__doc__,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--lock",
        type=Path,
        metavar="FILE",
        help="the lock (default: requirements.lock of the checkout)",
    )
    parser.add_argument(
        "--python",
        choices=PYTHONS,
        action="append",
        help="of the companion; may be given more than once (default: all three, "
        "with --download 3.12)",
    )
    parser.add_argument(
        "--download",
        type=Path,
        metavar="DIR",
        help="download the wheels into a folder, for --wheels of a race",
    )
    return parser


def run(args) -> int:
    """Does what parsed arguments ask for; returns the exit code."""
    pins = read_lock(args.lock or checkout_path() / "requirements.lock")
    pythons = args.python or (["3.12"] if args.download else list(PYTHONS))
    found = {}
    with Progress(console=Console(stderr=True), transient=True) as progress:
        for python in progress.track(pythons, description="Asking pip"):
            if args.download:
                download(pins, python, args.download)
            else:
                found[python] = find_wheels(pins, python)
    if args.download:
        print(f"The wheels are in {args.download}: race with --wheels {args.download}")
        return 0
    Console().print(make_table(pins, found))
    missing = sorted(
        {
            pin.name
            for pin in pins
            for python, names in found.items()
            if pin.is_for(python) and pin.name not in names
        }
    )
    print(
        f"No wheel for {_MACHINE}: {', '.join(missing)}"
        if missing
        else f"Every package has a wheel for {_MACHINE}."
    )
    return 1 if missing else 0


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    args = make_parser().parse_args(argv)
    return exit_code(lambda: run(args))


if __name__ == "__main__":
    sys.exit(main())
