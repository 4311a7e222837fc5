"""Brings to a companion computer what a race needs, once: an environment of the lock, airrace."""

import dataclasses as dc
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)

from airrace.common.errors import UserError
from airrace.common.files import digest, files_in
from airrace.common.resources import PACKAGE
from airrace.hitl.companion.ssh import ConnectionLost, SshConnection
from airrace.hitl.companion.ssh_errors import file_error, is_disk_full, last_line

if TYPE_CHECKING:
    from airrace.hitl.companion.address import Address

_SCRIPT = Path(__file__).with_name("board.sh")
_ROOM = 1_500_000  # kB; the packages take 860 MB, and their byte code; their wheels 265 MB
_MARK = "airrace-"
LOCK = "requirements-run.lock"  # what running takes, without what developing takes
_FOLDERS = ("airrace", "models")


@dc.dataclass(frozen=True)
class Board:
    """A companion computer that is set up."""

    cache: str  # the folder there of everything that airrace keeps
    python: str  # of the environment there
    package: str  # the folder there with airrace in it


def checkout_path() -> Path:
    """Returns the folder of the checkout that this airrace runs from.

    Raises UserError if it runs from an installed package.
    """
    root = PACKAGE.parent
    if not all((root / name).is_file() for name in ("pyproject.toml", LOCK)):
        raise UserError(
            f"airrace runs from {root}, which is no checkout of it, so that it cannot "
            "be brought to a companion; start it with ./run.bash of a checkout."
        )
    return root


def source_digest(root: Path) -> str:
    """Returns the digest of all of a checkout that a companion gets."""
    return digest(*(root / name for name in _FOLDERS))


def source_files(root: Path) -> dict[str, bytes]:
    """Returns all of a checkout that a companion gets: path to contents.

    Raises UserError if a file cannot be read.
    """
    try:
        return {
            file.relative_to(root).as_posix(): file.read_bytes()
            for file in files_in(*(root / name for name in _FOLDERS))
        }
    except OSError as e:
        raise UserError(
            f"{e.filename} cannot be read ({e.strerror}), so that airrace cannot be brought to "
            f"the companion; mend the checkout in {root}."
        ) from None


def board_command(action: str, *arguments: object) -> tuple[list[str], bytes]:
    """Returns the command line of an action of board.sh, and its standard input."""
    return ["sh", "-s", action, *map(str, arguments)], _SCRIPT.read_bytes()


def event_of(line: str) -> tuple[str, str]:
    """Returns kind and text of a line of board.sh; the kind of any other line is ""."""
    kind, separator, text = line.removeprefix(_MARK).partition(": ")
    return (kind, text) if line.startswith(_MARK) and separator else ("", line)


def failure(events: list[tuple[str, str]], code: int | None, address: "Address") -> Exception:
    """Returns the exception for an action of board.sh that failed.

    Args:
        events: that it wrote, see event_of().
        code: its exit code, None if the connection was lost.
    """
    if code is None:
        return ConnectionLost("it ended in the set-up")
    said = "\n".join(text for kind, text in events if not kind)
    if is_disk_full(said):
        return file_error(said, "~/.cache/airrace", address)
    if events and events[-1][0] == "refused":
        names = {"{host}": address.host, "{said}": last_line(said)}
        sentence = events[-1][1]
        for name, value in names.items():
            sentence = sentence.replace(name, value)
        return UserError(sentence)
    return RuntimeError(f"airrace's program on {address.host} ended with {code}: {said}")


def set_up(
    connection: SshConnection,
    address: "Address",
    checkout: Path,
    wheels: Path | None,
    display: "SetUpDisplay",
) -> Board:
    """Brings over what is not there yet and has it installed.

    Args: checkout: whose airrace and requirements-run.lock to bring. wheels: a folder of wheels to
    install from, instead of the index that pip is set to there; None: no.

    Raises:
        UserError: if that fails.
        ConnectionLost: if the connection goes.
    """
    display.step("looking for Python")
    lock = checkout / LOCK
    environment, package = digest(lock), source_digest(checkout)
    found = inspect_board(connection, address, environment, package)
    cache, locked = found["cache"], []
    if "environment" not in found:
        connection.put(f"{cache}/locks", {f"{environment}.txt": lock.read_bytes()})
    if "environment" not in found and wheels is not None:
        locked = find_wheels(wheels, lock)
        display.step("bringing the wheels")
        sizes = [wheel.stat().st_size for wheel in locked]
        for i, wheel in enumerate(locked):
            display.show(sum(sizes[:i]), sum(sizes))
            connection.put(f"{cache}/wheelhouse/{environment}", {wheel.name: wheel.read_bytes()})
    if "package" not in found:
        display.step("bringing this airrace")
        # What says that it is complete comes last.
        connection.put(f"{cache}/packages/{package}", {**source_files(checkout), "complete": b""})
    total = sum("==" in line for line in lock.read_text(encoding="utf-8").splitlines())
    source = "OFFLINE" if locked else "ONLINE"
    arguments = environment, package, found["python"], _ROOM, source
    lines, events = connection.start(*board_command("set_up", *arguments)), []
    while isinstance(line := lines.get(), str):
        events.append(event_of(line))
        kind, text = events[-1]
        if kind == "step":
            display.step(text)
            events.clear()
        elif text.startswith(("Collecting", "Processing")):  # pip's
            done = sum(said.startswith(("Collecting", "Processing")) for _, said in events)
            display.show(min(done, total), total)
        elif text.startswith("Installing collected") and len(events) >= total:
            display.step("unpacking the wheels")
    if line != 0:
        raise failure(events, line, address)
    return Board(
        cache, f"{cache}/environments/{environment}/bin/python", f"{cache}/packages/{package}"
    )


def inspect_board(
    connection: SshConnection, address: "Address", environment: str, package: str
) -> dict[str, str]:
    """Returns what is on a companion: ``cache``, ``python``, and what else board.sh tells.

    Raises:
        UserError: if it is no computer for airrace.
        ConnectionLost: if the connection goes.
    """
    code, output, error = connection.run(*board_command("inspect", environment, package))
    output = output.decode(errors="replace")
    events = [event_of(line) for line in output.splitlines()]
    if "cache" not in dict(events):
        said = last_line(output + error)[:200]
        raise UserError(
            f"{address.host} runs no commands over ssh ({said}); give the user a shell there."
        )
    if code:
        raise failure(events, code, address)
    return dict(events)


def find_wheels(folder: Path, lock: Path) -> list[Path]:
    """Returns the wheels of a folder that a lock has, by their hashes.

    Raises UserError if there are none.
    """
    text = lock.read_text(encoding="utf-8")
    try:
        wheels = [
            path
            for path in sorted(folder.glob("*.whl"))
            if hashlib.sha256(path.read_bytes()).hexdigest() in text
        ]
    except OSError as e:
        raise UserError(
            f"--wheels {folder} cannot be read ({e.strerror}); name another folder."
        ) from None
    if not wheels:
        raise UserError(
            f"--wheels {folder} holds no wheel of {lock.name}; fill it with pip download, "
            "see docs/board.md."
        )
    return wheels


class SetUpDisplay(Progress):
    """Shows a set-up on standard error; inside its ``with`` block a bar is live.

    The bar vanishes at the end. Where there is no terminal, each step is a line.
    """

    def __init__(self, host: str, console: Console | None = None):
        """Args: host: what to call the companion. console: standard error by default."""
        console = console or Console(stderr=True)
        super().__init__(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._host, self._task = host, self.add_task("", total=None)

    def step(self, text: str) -> None:
        """Shows what is being done from now on."""
        if not self.console.is_terminal:
            self.console.out(f"airrace: {self._host}: {text}", highlight=False)
        self.reset(self._task, description=f"{self._host}: {text}", total=None)

    def show(self, done: int, total: int) -> None:
        """Shows how far the step is."""
        self.update(self._task, completed=done, total=total)
