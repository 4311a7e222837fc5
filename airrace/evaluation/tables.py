"""The tables of an evaluation, in Markdown and for the terminal."""

from pathlib import Path

from rich.table import Table
from rich.text import Text

from airrace.common.files import write_json, write_text
from airrace.evaluation.store import SUMMARY, TABLE
from airrace.evaluation.summary import race_line, summarize
from airrace.scenario import trajectory_name

_COLUMNS = ("", "n", "mean", "median", "min", "max")
# Key of the summary, what it is called, factor and decimals.
_DISTRIBUTIONS = (
    ("exploration_s", "exploration (s)", 1.0, 1),
    ("lap_s", "lap (s)", 1.0, 2),
    ("lap_speed", "lap, straight from gate to gate (m/s)", 1.0, 2),
    ("map_rms_m", "map error, RMS (cm)", 100.0, 1),
)
_RACE_COLUMNS = (
    "seed",
    "gates",
    "length (m)",
    "finished",
    "exploration (s)",
    "laps",
    "mean lap (s)",
    "best lap (s)",
    "map RMS (cm)",
    "why it ended",
)


def write_report(folder: Path, settings: dict, rows: list[dict]) -> dict:
    """Writes evaluation.json and evaluation.md, and returns what the former holds.

    They depend on settings and results alone: not on the order in which the
    races ended, and not on who flew them how fast.

    Raises:
        UserError: if they cannot be written.
    """
    lines = [race_line(row) for row in rows]
    evaluation = {
        "complete": len(rows) == settings["tracks"],
        "settings": settings,
        "summary": summarize(lines),
        "races": lines,
    }
    write_json(folder / SUMMARY, evaluation)
    write_text(folder / TABLE, markdown(evaluation))
    return evaluation


def title(settings: dict) -> str:
    """Returns what was evaluated, on one line."""
    scenario = settings["scenario"]
    drone, kind = Path(scenario["drone"]).name, trajectory_name(scenario["trajectory"])
    return (
        f"{drone}, {kind}, {settings['scenario_name']}: {settings['tracks']} "
        f"races of {scenario['laps']} laps, {settings['track']}, seeds from "
        f"{settings['track_seed']}"
    )


def finish_line(summary: dict) -> str:
    """Returns the finish rate, its interval, and the collisions, as a sentence."""
    if not summary["races"]:
        return "No race has ended yet."
    low, high = summary["finish_rate_95"]
    return (
        f"Finished {summary['finished']} of {summary['races']} races: "
        f"{100 * summary['finish_rate']:.1f} %, 95 % interval {100 * low:.1f} to "
        f"{100 * high:.1f} %; explored {summary['explored']}, collisions {summary['collisions']}."
    )


def distribution_rows(summary: dict) -> list[tuple]:
    """Returns the rows of the table of distributions: a name and five numbers as text."""
    rows = []
    for key, name, factor, decimals in _DISTRIBUTIONS:
        values = summary[key]
        numbers = (
            ["-"] * 4
            if values is None
            else [f"{factor * values[column]:.{decimals}f}" for column in _COLUMNS[2:]]
        )
        rows.append((name, str(values["n"] if values else 0), *numbers))
    return rows


def markdown(evaluation: dict) -> str:
    """Returns evaluation.md."""
    summary = evaluation["summary"]
    parts = [
        f"# {_escaped(title(evaluation['settings']))}",
        ""
        if evaluation["complete"]
        else f"Not complete: {summary['races']} of {evaluation['settings']['tracks']} races have "
        "ended.",
        finish_line(summary),
        _markdown_table(_COLUMNS, distribution_rows(summary)),
        _markdown_table(("did not finish", "races"), summary["dnf_reasons"].items())
        if summary["dnf_reasons"]
        else "",
        _markdown_table(_RACE_COLUMNS, map(_race_row, evaluation["races"])),
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def terminal_tables(summary: dict) -> list[Table]:
    """Returns the tables for the terminal."""
    tables = [_terminal_table(_COLUMNS, distribution_rows(summary))]
    if summary["dnf_reasons"]:
        tables.append(_terminal_table(("did not finish", "races"), summary["dnf_reasons"].items()))
    return tables


def _race_row(line: dict) -> tuple:
    def number(value, decimals):
        return "-" if value is None else f"{value:.{decimals}f}"

    rms = line["map_rms_m"]
    return (
        line["seed"],
        line["gates"],
        number(line["length_m"], 1),
        "yes" if line["finished"] else "no",
        number(line["exploration_s"], 1),
        len(line["lap_times_s"]),
        number(line["mean_lap_s"], 2),
        number(line["best_lap_s"], 2),
        number(None if rms is None else 100 * rms, 1),
        line["dnf_reason"] or "finished",
    )


def _markdown_table(columns, rows) -> str:
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *rows]
    return "\n".join(f"| {' | '.join(_escaped(str(c)) for c in line)} |" for line in lines)


def _escaped(text: str) -> str:
    """Keeps what errors and names say from ending a cell or becoming markup."""
    for character in "\\|<*`_":
        text = text.replace(character, "\\" + character)
    return " ".join(text.split())


def _terminal_table(columns, rows) -> Table:
    table = Table()
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if i else "left")
    for row in rows:
        table.add_row(*(Text(str(cell)) for cell in row))  # reasons may look like markup
    return table
