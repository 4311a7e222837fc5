"""The firmware's settings: lines of its command line, given to it and read back."""

import contextlib
import itertools
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from airrace.betaflight.firmware import BUILD_AGAIN, Firmware
from airrace.betaflight.firmware_process import NO_RADIO, PERIOD, FirmwareProcess
from airrace.common.errors import UserError
from airrace.common.files import read_regular
from airrace.common.processes import ending
from airrace.common.words import count, printable

FILE_NAME = "betaflight.txt"  # in a drone's folder, and in that of a run
_EEPROM = "eeprom.bin"
_BEGIN = "#"  # of the command line
_PROMPT = b"\n# "
_REFUSED = re.compile(r"###ERROR(?: IN \w+)?: *(.*?)###")
_SAVED = f"Betaflight {ending(0)}"  # what becomes of the process when its settings are saved
# They end the command line, or begin and end what is given as one: it is, in any case.
_NOT_GIVEN = ("batch", "save", "exit", "quit", "bl", "reboot")
_BOOT = 0.5  # s, of its own time, until the firmware has opened its command line
_PATIENCE = 20.0  # s, of its own time, for an answer
_POLL = 0.0002  # s, to wait for an answer between two steps
_LONGEST = 200  # characters of a line that are read
_MOST, _MOST_LINES = 1 << 20, 5000  # bytes of a file, and lines: a dump has 40 000 and 1500


class Refused(NamedTuple):
    """A line of settings that the firmware does not take."""

    line: str
    answer: str  #: what the firmware says to it

    def __str__(self) -> str:
        return f"'{self.line}' ({self.answer})"


def lines_of(path: Path) -> list[str]:
    """Returns the lines of a file of settings, without comments; at least one.

    Raises:
        UserError: if it cannot be read as text, or holds none.
    """
    try:
        text = read_regular(path, _MOST + 1).decode()
    except UnicodeDecodeError:
        raise UserError(
            f"{path} is no text: it must hold lines of Betaflight's command line, as `diff all` "
            "prints them."
        ) from None
    except OSError as e:
        raise UserError(f"{path} cannot be read ({e.strerror}): name a file of settings.") from None
    all_lines = (line.partition("#")[0].strip()[:_LONGEST] for line in text.splitlines())
    lines = [line for line in all_lines if line and line.split()[0].lower() not in _NOT_GIVEN]
    if len(text) > _MOST or len(lines) > _MOST_LINES:
        raise UserError(
            f"{path} is too long to be settings: give what `diff all` prints, at most "
            f"{_MOST_LINES} lines."
        )
    if not lines:
        raise UserError(
            f"{path} holds no settings: it must hold lines of Betaflight's command line."
        )
    return lines


def configure(firmware: Firmware, source: Path, folder: Path) -> tuple[str, list[Refused]]:
    """Gives settings to the firmware, which keeps them in a folder for its next start.

    Args:
        firmware: what to run.
        source: the file of settings.
        folder: an empty one.

    Returns:
        all settings as the firmware then has them, as `dump` prints them, its version first; and
        the lines that it refuses.

    Raises:
        UserError: if it takes none of the lines, or does not keep them.
    """
    lines = lines_of(source)
    with contextlib.closing(FirmwareProcess(firmware, folder)) as process:
        with _command_line(process) as ask:
            refused = [
                Refused(printable(line), printable(found[1].strip().lower()))
                for line in lines
                if (found := _REFUSED.search(ask(line)))
            ]
            if len(refused) == len(lines):
                raise UserError(
                    f"Betaflight takes none of the {count(len(lines), 'line')} of {source}, such "
                    f"as {refused[0]}: it must hold lines of its command line."
                )
            dump = ask("dump")
            with contextlib.suppress(_Ended):
                ask("save")
    if process.problem != _SAVED or not (folder / _EEPROM).is_file():
        raise UserError(f"Betaflight does not keep the settings of {source}: try it again.")
    _, _, kept = dump.replace("\r", "").partition("\n")
    return kept.rpartition("\n# ")[0].strip() + "\n", refused


class _Ended(UserError):
    """The firmware has ended while it was asked."""


@contextlib.contextmanager
def _command_line(process: FirmwareProcess) -> Iterator[Callable[[str], str]]:
    """Yields a function that gives a line to the firmware's command line, and returns its answer.

    Time goes on for the firmware while somebody waits for it, and only then.
    """
    process.hold(_BOOT, NO_RADIO)
    if process.port is None:
        raise UserError(f"{process.problem or 'Betaflight has no command line'}: {BUILD_AGAIN}.")
    with process.connect() as connection:
        connection.settimeout(_POLL)

        def send(text: str, mark: bytes) -> str:
            line, _, _ = text.partition("\n")
            connection.sendall(text.encode("ascii", "replace"))
            answer = b""
            for _ in range(round(_PATIENCE / PERIOD)):
                process.step(NO_RADIO)
                if process.problem is not None:
                    raise _Ended(
                        f"{process.problem}, after '{printable(line)}' of its settings: leave that "
                        "line out."
                    )
                with contextlib.suppress(OSError):  # there is nothing yet
                    answer += connection.recv(65536)
                if mark in answer and answer.endswith(_PROMPT):
                    return answer.rpartition(mark)[0].decode("utf-8", "replace")
            raise UserError(f"Betaflight does not answer to '{line}' of its settings.")

        numbers = itertools.count()

        def ask(line: str) -> str:
            # A comment after the line, whose echo is the end of the answer.
            mark = f"#end of {next(numbers)}"
            return send(f"{line}\n{mark}\n", mark.encode())

        send(_BEGIN, _PROMPT)
        yield ask


def state_of_arming(process: FirmwareProcess) -> str:
    """Returns what a firmware that runs says of why it does not arm."""
    with _command_line(process) as ask:
        found = re.search(r"Arming disable flags: *(.*)", ask("status"))
    flags = found[1].replace("CLI", "").split() if found else []
    return ", ".join(flags) or "it does not say why"


def values_of(dump: str) -> dict[str, str]:
    """Returns the values that a dump sets, by name; of profiles, those of the last one named."""
    return dict(re.findall(r"^set (\w+) = (.*)$", dump, re.MULTILINE))
