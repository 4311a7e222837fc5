"""The firmware's settings: lines of its command line, given to it and read back."""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from airrace.betaflight.firmware import Firmware
from airrace.betaflight.firmware_process import NO_RADIO, PERIOD, FirmwareProcess
from airrace.common.errors import UserError
from airrace.common.words import count, printable

FILE_NAME = "betaflight.txt"  # in a drone's folder, and in that of a run
_EEPROM = "eeprom.bin"
_BEGIN = "#"  # of the command line
_PROMPT = b"\n# "
_REFUSED = re.compile(r"###ERROR(?: IN \w+)?: *(.*?)###|(Unknown command|UNKNOWN COMMAND)[^\n]*")
# They end the command line, or begin and end what is given as one: it is, in any case.
_NOT_GIVEN = ("batch", "save", "exit", "quit")
_BOOT = 0.5  # s, of its own time, until the firmware has opened its command line
_PATIENCE = 20.0  # s, of its own time, for an answer
_POLL = 0.0002  # s, to wait for an answer between two steps
_LONGEST = 200  # characters of a line that are read


class Refused(NamedTuple):
    """A line of settings that the firmware does not take."""

    line: str
    answer: str  #: what the firmware says to it

    def __str__(self) -> str:
        return f"'{self.line}' ({self.answer})"


def lines_of(path: Path) -> list[str]:
    """Returns the lines of a file of settings, without comments.

    Raises:
        UserError: if it cannot be read as text.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise UserError(
            f"{path} is no text: it must hold lines of Betaflight's command line, as `diff all` "
            "prints them."
        ) from None
    except OSError as e:
        raise UserError(f"{path} cannot be read ({e.strerror}): name a file of settings.") from None
    lines = (line.partition("#")[0].strip()[:_LONGEST] for line in text.splitlines())
    return [line for line in lines if line and line.split()[0] not in _NOT_GIVEN]


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
            ask(_BEGIN)
            answers = [(line, ask(line)) for line in lines]
            refused = [
                Refused(printable(line), printable(_complaint(found)))
                for line, answer in answers
                if (found := _REFUSED.search(answer))
            ]
            if lines and len(refused) == len(lines):
                raise UserError(
                    f"Betaflight takes none of the {count(len(lines), 'line')} of {source}, such "
                    f"as {refused[0]}: it must hold lines of its command line."
                )
            dump = ask("dump")
            ask("save", last=True)
    if process.problem is None or not (folder / _EEPROM).is_file():
        raise UserError(f"Betaflight does not keep the settings of {source}: look at its lines.")
    _, _, kept = dump.replace("\r", "").partition("\n")
    return kept.rpartition("\n# ")[0].strip() + "\n", refused


def _complaint(found: re.Match) -> str:
    return (found[1] or found[2]).strip().lower()


@contextlib.contextmanager
def _command_line(process: FirmwareProcess) -> Iterator:
    """Yields a function that gives a line to the firmware's command line, and returns its answer.

    Time goes on for the firmware while somebody waits for it, and only then.
    """
    for _ in range(round(_BOOT / PERIOD)):
        process.step(NO_RADIO)
    if process.port is None:
        raise UserError(f"{process.problem or 'Betaflight has no command line'}.")
    with process.connect() as connection:
        connection.settimeout(_POLL)
        asked = 0

        def ask(line: str, last: bool = False) -> str:
            nonlocal asked
            asked += 1
            # A comment after the line, whose echo is the end of the answer.
            mark = b"" if line == _BEGIN else b"#end of %d" % asked
            rest = mark and b"\n" + mark + b"\n"
            connection.sendall(line.encode("ascii", "replace") + rest)
            answer = b""
            for _ in range(round(_PATIENCE / PERIOD)):
                process.step(NO_RADIO)
                if process.problem is not None:
                    if last:
                        return answer.decode("utf-8", "replace")
                    raise UserError(f"{process.problem} at the line '{line}' of its settings.")
                with contextlib.suppress(TimeoutError, OSError):
                    answer += connection.recv(65536)
                if answer.endswith(_PROMPT) and mark in answer and not last:
                    return answer.rpartition(mark)[0].decode("utf-8", "replace") if mark else ""
            raise UserError(f"Betaflight does not answer to the line '{line}' of its settings.")

        yield ask


def state_of_arming(process: FirmwareProcess) -> str:
    """Returns what a firmware that runs says of why it does not arm."""
    with _command_line(process) as ask:
        ask(_BEGIN)
        found = re.search(r"Arming disable flags: *(.*)", ask("status"))
    flags = found[1].replace("CLI", "").split() if found else []
    return ", ".join(flags) or "it does not say why"


def values_of(dump: str) -> dict[str, str]:
    """Returns the values that a dump sets, by name; of profiles, those of the last one named."""
    return dict(re.findall(r"^set (\w+) = (.*)$", dump, re.MULTILINE))
