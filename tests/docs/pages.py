"""The examples of README.md and docs/: blocks of code, and how their output is compared."""

import math
import re
import textwrap
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
_BLOCK = re.compile(
    r"(?:^ *<!-- (?P<note>[^\n]*) -->\n)?"
    r"^(?P<indent> *)```(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.M | re.S,
)
_NUMBER = r"-?\d+(?:\.\d+)?(?![.\d]*\d)"


class Block(NamedTuple):
    """A fenced block of code.

    Attributes:
        page: where it is.
        line: of the page.
        language: behind the fence.
        note: of the comment right above it, such as ``figures within 2 %`` or ``file: a.py``.
        text: between the fences.
    """

    page: Path
    line: int
    language: str
    note: str
    text: str

    def __str__(self):
        return f"{self.page.name}:{self.line}"

    @property
    def tolerance(self) -> float:
        """By how much figures may differ, as a share of them."""
        found = re.fullmatch(r"figures within ([\d.]+) %", self.note)
        return float(found[1]) / 100 if found else 0.0


def blocks(*languages: str) -> list[Block]:
    """Returns the blocks of all pages in one of some languages."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in _BLOCK.finditer(text):
            line = text.count("\n", 0, match.start()) + 1
            code = textwrap.dedent(match["text"])
            found.append(Block(page, line, match["language"], match["note"] or "", code))
    return [block for block in found if block.language in languages]


def console_commands(block: Block) -> list[tuple[str, list[str]]]:
    """Returns pairs of a command and the lines that it is said to print."""
    pairs = []
    for line in block.text.replace("\\\n", "").splitlines():
        if line.startswith("$ "):
            pairs.append((line[2:], []))
        else:
            pairs[-1][1].append(line)
    return pairs


def same_lines(expected: list[str], actual: list[str], tolerance: float) -> bool:
    """Returns whether an output is what a page says.

    Args:
        expected: lines; one that is ``...`` stands for any lines, ``...`` in a line for
            anything.
        actual: lines.
        tolerance: by which figures may differ, as a share of them; those with a decimal point
            also by one of the last digit.
    """
    if not expected:
        return not actual
    if expected[0] == "...":
        rest = expected[1:]
        return any(same_lines(rest, actual[k:], tolerance) for k in range(len(actual) + 1))
    return (
        bool(actual)
        and same_line(expected[0], actual[0], tolerance)
        and same_lines(expected[1:], actual[1:], tolerance)
    )


def same_line(expected: str, actual: str, tolerance: float) -> bool:
    """Returns whether a line is what a page says; see same_lines()."""
    expected, actual = " ".join(expected.split()), " ".join(actual.split())
    pattern = ""
    for part in re.split(rf"(\.\.\.|{_NUMBER})", expected):
        is_number = re.fullmatch(_NUMBER, part)
        pattern += ".*" if part == "..." else f"({_NUMBER})" if is_number else re.escape(part)
    found = re.fullmatch(pattern, actual)
    numbers = [part for part in re.findall(rf"\.\.\.|{_NUMBER}", expected) if part != "..."]
    return found is not None and all(
        map(lambda a, b: _close(a, b, tolerance), numbers, found.groups())
    )


def _close(expected: str, actual: str, tolerance: float) -> bool:
    if not tolerance:
        return expected == actual
    _, _, decimals = expected.partition(".")
    last_digit = 10.0 ** -len(decimals) if decimals else 0.0
    margin = tolerance * abs(float(expected)) + last_digit
    return math.isclose(float(expected), float(actual), rel_tol=0.0, abs_tol=1.000001 * margin)
