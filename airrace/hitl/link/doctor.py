"""What a link has been found to do, beside what a race needs."""

import dataclasses as dc

import numpy as np
from rich.table import Table

_MS = 1e3
_GOOD, _WEAK, _BAD = "good", "weak", "bad"
_BUFFER = 1 << 20  # bytes
_OVERHEAD = 2  # memory that a part of a datagram takes, in its sizes
_ROUTE = "check the cable (ethtool: 1000 Mb/s, full duplex), no Wi-Fi, no other traffic"
_LOAD = "end other programs on both computers; on a Jetson, nvpmodel -m 0 and jetson_clocks"


@dc.dataclass(frozen=True)
class Row:
    """One finding.

    Attributes:
        what: was measured.
        found: as text.
        needed: as text: what is good, what a race can just do with.
        verdict: "good", "weak" (a race works, worse) or "bad" (it does not start).
        remedy: what to do unless it is good.
    """

    what: str
    found: str
    needed: str
    verdict: str
    remedy: str


def diagnose(findings) -> list[Row]:
    """Returns the rows of the doctor's table. Args: findings: LinkFindings."""
    f = findings
    sent = f.picture_rate * f.duration
    picture_loss = max(1.0 - f.pictures.received / max(sent, 1.0), 0.0)
    states = f.states.received + f.states.missing
    ages = f.ages if len(f.ages) else np.array([np.inf])
    p50, p99 = np.percentile(ages, (50, 99)) if len(f.ages) else (np.inf, np.inf)
    commands = f.commands.received / f.duration
    return [
        _row("pictures that arrive", f.pictures.rate, "{:.1f} Hz", 25.0, 10.0, _LOAD, more=True),
        _row(
            "pictures lost",
            100 * picture_loss,
            "{:.1f} %",
            2.0,
            60.0,
            "sysctl -w net.core.rmem_max=4194304 on both computers; " + _ROUTE,
        ),
        _row("age of a picture, p99", _MS * f.pictures.age_p99, "{:.1f} ms", 30.0, 150.0, _ROUTE),
        _row(
            "jitter of the pictures, p99", _MS * f.pictures.jitter, "{:.1f} ms", 15.0, 100.0, _LOAD
        ),
        _row("states lost", 100 * f.states.missing / max(states, 1), "{:.2f} %", 1.0, 10.0, _ROUTE),
        _row(
            "commands that come back",
            commands,
            "{:.0f} Hz",
            0.8 * f.state_rate,
            0.2 * f.state_rate,
            _LOAD,
            more=True,
        ),
        _row("commands lost", 100 * f.commands.loss, "{:.2f} %", 1.0, 10.0, _ROUTE),
        _row("age of a command's state, median", _MS * p50, "{:.1f} ms", 20.0, 100.0, _ROUTE),
        _row("age of a command's state, p99", _MS * p99, "{:.1f} ms", 50.0, 200.0, _LOAD),
        _row("round trip", _MS * f.round_trip, "{:.2f} ms", 10.0, 100.0, _ROUTE),
        Row("offset of the clocks", f"{f.offset:+.4f} s", "any", _GOOD, ""),
        Row("size of a picture", f"{f.pictures.bytes / 1e3:.0f} kB", "any", _GOOD, ""),
        _row("encoding a picture here", _MS * f.encode_time, "{:.1f} ms", 8.0, 30.0, _LOAD),
        _row(
            "decoding a picture there", _MS * f.pictures.decode_time, "{:.1f} ms", 8.0, 30.0, _LOAD
        ),
        _row(
            "receive buffer there, at most",
            f.receive_buffer / 1024,
            "{:.0f} KiB",
            _BUFFER / 1024,
            0.0,
            "sysctl -w net.core.rmem_max=4194304 there",
            more=True,
        ),
        _row(
            "memory for torn pictures there",
            100 * _torn(f, picture_loss),
            "{:.0f} %",
            50.0,
            100.0,
            "sysctl -w net.ipv4.ipfrag_time=1 there",
        ),
    ]


def _torn(findings, loss) -> float:
    """Returns which share of the kernel's memory for torn datagrams fills up.

    It keeps the parts that came of each, for as long as it is set to. When that memory is full,
    no picture arrives any more.
    """
    f = findings
    kept = loss * f.picture_rate * f.fragment_time * _OVERHEAD * f.pictures.bytes
    return kept / f.fragment_memory if f.fragment_memory else 0.0


def _row(what, value, form, good, bearable, remedy, more=False) -> Row:
    """Returns a row; ``more`` says that more is better."""
    sign = "≥" if more else "≤"
    fits = (lambda limit: value >= limit) if more else (lambda limit: value <= limit)
    verdict = _GOOD if fits(good) else _WEAK if fits(bearable) else _BAD
    needed = f"{sign} {form.format(good)}, at {'least' if more else 'most'} {form.format(bearable)}"
    return Row(what, form.format(value), needed, verdict, "" if verdict == _GOOD else remedy)


def refusal(rows: list[Row]) -> str | None:
    """Returns why a race cannot start on a link, one sentence with the remedy, or None."""
    bad = [row for row in rows if row.verdict == _BAD]
    if not bad:
        return None
    first = bad[0]
    return (
        f"The link cannot carry a race: {first.what} {first.found} ({first.needed}); "
        f"{first.remedy}; --doctor tells more."
    )


def make_table(rows: list[Row]) -> Table:
    """Returns the doctor's table."""
    table = Table(title="The link between simulation and autonomy")
    for heading, justify in (
        ("what", "left"),
        ("found", "right"),
        ("needed", "left"),
        ("", "left"),
        ("remedy", "left"),
    ):
        table.add_column(heading, justify=justify)
    styles = {_GOOD: "green", _WEAK: "yellow", _BAD: "red"}
    for row in rows:
        style = styles[row.verdict]
        table.add_row(
            row.what, row.found, row.needed, f"[{style}]{row.verdict}[/{style}]", row.remedy
        )
    return table
