"""Holds the race of two computers against each other: python -m tools.arm64_table X86 ARM.

Prints a Markdown table of the events and laps of two folders of results, as tools/arm64_test.bash
leaves them. The exit code is 1 if an event differs, or the time of a lap by more than 1e-6 s.
"""

import json
import sys
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

_TOLERANCE = 1e-6  # s


class Row(NamedTuple):
    """A line of the table.

    Attributes:
        name: of what is compared.
        x86, arm: its values, as text.
        difference: between them, as text.
        agrees: whether the difference is one of rounding.
    """

    name: str
    x86: str
    arm: str
    difference: str
    agrees: bool


def rows(x86: dict, arm: dict) -> Iterator[Row]:
    """Yields the lines of the table. Args: x86, arm: what race.json holds."""
    events = [race["exploration"]["events"] for race in (x86, arm)]
    for pair in zip_longest(*events):
        names = [f"{event['state']}: {event['reason']}" if event else "-" for event in pair]
        if names[0] != names[1]:
            yield Row("event", *names, "not the same", False)
        else:
            yield _times(names[0], [event["time_s"] for event in pair], 2)
    for number, pair in enumerate(zip_longest(x86["laps"], arm["laps"]), start=1):
        name = f"lap {number}"
        if None in pair:
            yield Row(name, *("flown" if lap else "-" for lap in pair), "not the same", False)
            continue
        yield _times(name, [lap["time_s"] for lap in pair], 9)
        offsets = [lap["gate_offsets_m"] for lap in pair]
        farthest = [f"{max(each):.6f} m" for each in offsets]
        difference = max(abs(a - b) for a, b in zip(*offsets, strict=True))
        name += ", farthest from the middle of a gate"
        yield Row(name, *farthest, _small(difference, "m"), True)


def _times(name, times, digits):
    difference = abs(times[0] - times[1])
    texts = [f"{time:.{digits}f} s" for time in times]
    return Row(name, *texts, _small(difference, "s"), difference <= _TOLERANCE)


def _small(number, unit):
    return f"{number:.1e} {unit}" if number else "0"


def agree(x86: dict, arm: dict) -> bool:
    """Whether both races finished, with the same events and laps."""
    return x86["finished"] and arm["finished"] and all(row.agrees for row in rows(x86, arm))


def table(x86: dict, arm: dict) -> str:
    """Returns the table, in Markdown."""
    lines = ["| | x86-64 | 64-bit Arm | difference |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row[:4])} |" for row in rows(x86, arm)]
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """The command-line program; returns the exit code."""
    x86, arm = (json.loads((Path(each) / "race.json").read_text("utf-8")) for each in arguments)
    print(table(x86, arm))
    return 0 if agree(x86, arm) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
