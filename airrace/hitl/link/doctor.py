"""What a link has been found to do, beside what a race needs."""

from typing import NamedTuple

import numpy as np
from rich.markup import escape
from rich.table import Table

from airrace.hitl.link.probe import PICTURE, STATE, LinkFindings

GOOD, WEAK, BAD = "good", "weak", "bad"
_STYLES = {GOOD: "green", WEAK: "yellow", BAD: "red"}
_BUFFER = 1024  # KiB
_OVERHEAD = 2  # memory that a part of a datagram takes, in its sizes
_ROUTE = "check the cable (ethtool: 1000 Mb/s, full duplex), no Wi-Fi, no other traffic"
_LOAD = "end other programs, or race with --realtime_rate 0.5 or --lockstep"
_SOCKETS = "sysctl -w net.core.rmem_max=4194304"
_FRAGMENTS = "sysctl -w net.ipv4.ipfrag_time=1 there"


class Row(NamedTuple):
    """One finding."""

    what: str  # was measured
    found: str  # as text
    needed: str  # as text: what is good, what a race can just do with
    verdict: str  # "good", "weak" (a race works, worse) or "bad" (it does not start)
    remedy: str  # what to do unless it is good


def diagnose(findings: LinkFindings) -> list[Row]:
    """Returns the rows of the doctor's table."""
    f = findings
    pictures, states, commands = f.received(PICTURE), f.received(STATE), f.commands
    loss = max(1.0 - pictures.received / max(f.picture_rate * f.duration, 1.0), 0.0)
    states_lost = states.missing / max(states.received + states.missing, 1)
    p50, p99 = np.percentile(f.ages, (50, 99)) if len(f.ages) else (np.inf, np.inf)
    # The kernel keeps the parts that came of each incomplete picture for fragment_time.
    # When its memory for them is full, no picture arrives any more.
    # One lost picture is left out: a test of a second has too few to make a rate of it.
    torn = max(loss - 1.0 / max(f.picture_rate * f.duration, 1.0), 0.0) * f.picture_rate
    kept = torn * f.status.fragment_time * _OVERHEAD * pictures.bytes
    share = kept / f.status.fragment_memory if f.status.fragment_memory else 0.0
    rate = f.state_rate
    table = (
        # What, found, form, good, bearable, remedy.
        ("pictures that arrive", pictures.rate, "{:.1f} Hz", 25.0, 10.0, _LOAD),
        ("pictures lost", 100 * loss, "{:.1f} %", 2.0, 60.0, f"{_SOCKETS} on both; {_ROUTE}"),
        ("age of a picture, p99", 1e3 * pictures.age_p99, "{:.1f} ms", 30.0, 150.0, _ROUTE),
        ("jitter of the pictures, p99", 1e3 * pictures.jitter, "{:.1f} ms", 15.0, 100.0, _LOAD),
        ("states lost", 100 * states_lost, "{:.2f} %", 1.0, 10.0, _ROUTE),
        (
            *("commands that come back", commands.received / f.duration, "{:.0f} Hz"),
            *(0.8 * rate, 0.2 * rate, _LOAD),
        ),
        ("commands lost", 100 * commands.loss, "{:.2f} %", 1.0, 10.0, _ROUTE),
        ("age of a command's state, median", 1e3 * p50, "{:.1f} ms", 20.0, 100.0, _ROUTE),
        ("age of a command's state, p99", 1e3 * p99, "{:.1f} ms", 50.0, 200.0, _LOAD),
        ("round trip", 1e3 * f.round_trip, "{:.2f} ms", 10.0, 100.0, _ROUTE),
        ("offset of the clocks", f.offset, "{:+.4f} s", None, None, ""),
        ("size of a picture", pictures.bytes / 1e3, "{:.0f} kB", None, None, ""),
        ("encoding a picture here", 1e3 * f.encode_time, "{:.1f} ms", 8.0, 30.0, _LOAD),
        ("decoding a picture there", 1e3 * pictures.decode_time, "{:.1f} ms", 8.0, 30.0, _LOAD),
        (
            *("receive buffer there, at most", f.status.receive_buffer / 1024, "{:.0f} KiB"),
            *(_BUFFER, 0.0, f"{_SOCKETS} there"),
        ),
        ("memory for torn pictures there", 100 * share, "{:.0f} %", 50.0, 100.0, _FRAGMENTS),
    )
    return [_judged(*row) for row in table]


def _judged(
    what: str, value: float, form: str, good: float | None, bearable: float | None, remedy: str
) -> Row:
    """Returns a row; more is better if ``good`` is more than ``bearable``; None: any will do."""
    if good is None or bearable is None:
        return Row(what, form.format(value), "any", GOOD, "")
    more = good > bearable
    fits = (lambda limit: value >= limit) if more else (lambda limit: value <= limit)
    verdict = GOOD if fits(good) else WEAK if fits(bearable) else BAD
    sign, word = ("≥", "least") if more else ("≤", "most")
    needed = f"{sign} {form.format(good)}, at {word} {form.format(bearable)}"
    return Row(what, form.format(value), needed, verdict, "" if verdict == GOOD else remedy)


def refusal(rows: list[Row]) -> str | None:
    """Returns why a race cannot start on a link, one sentence with the remedy, or None."""
    bad = [row for row in rows if row.verdict == BAD]
    if not bad:
        return None
    first = bad[0]
    return (
        f"The link cannot carry a race: {first.what} {first.found} ({first.needed}); "
        f"{first.remedy}; airrace doctor --link tells more."
    )


def make_table(rows: list[Row], title: str = "The link between simulation and autonomy") -> Table:
    """Returns the doctor's table."""
    table = Table(title=title)
    for heading in ("what", "found", "needed", "", "remedy"):
        table.add_column(
            heading, justify="right" if heading == "found" else "left", overflow="fold"
        )
    for row in rows:
        style = _STYLES[row.verdict]
        table.add_row(
            *map(escape, row[:3]), f"[{style}]{row.verdict}[/{style}]", escape(row.remedy)
        )
    return table
