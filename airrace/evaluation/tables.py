"""The tables of an evaluation, in Markdown."""

from collections.abc import Collection, Sequence
from pathlib import Path

from airrace.common.files import write_json, write_text
from airrace.common.words import count
from airrace.evaluation.store import SUMMARY, TABLE
from airrace.evaluation.summary import race_line, summarize
from airrace.scenario import trajectory_name

# Key of the summary, what it is called, factor and decimals.
_DISTRIBUTIONS = (
    ("exploration_s", "exploration (s)", 1.0, 1),
    ("lap_s", "lap (s)", 1.0, 2),
    ("lap_speed", "lap, straight from gate to gate (m/s)", 1.0, 2),
    ("map_rms_m", "map error, RMS (cm)", 100.0, 1),
)
# What the table of races calls a column, and how it is written.
_RACES = {
    "seed": lambda race: race["seed"],
    "gates": lambda race: race["gates"],
    "length (m)": lambda race: _number(race["length_m"], 1),
    "finished": lambda race: "yes" if race["finished"] else "no",
    "exploration (s)": lambda race: _number(race["exploration_s"], 1),
    "laps": lambda race: len(race["lap_times_s"]),
    "mean lap (s)": lambda race: _number(race["mean_lap_s"], 2),
    "best lap (s)": lambda race: _number(race["best_lap_s"], 2),
    "map RMS (cm)": lambda race: _number(race["map_rms_m"], 1, factor=100.0),
    "why it ended": lambda race: race["dnf_reason"] or "finished",
}


def write_summary(folder: Path, settings: dict, rows: list[dict]) -> dict:
    """Writes evaluation.json and evaluation.md, and returns what the former holds.

    They depend on settings and results alone: not on the order in which the
    races ended, and not on who flew them how fast.

    Raises UserError if they cannot be written.
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
        f"races of {count(scenario['laps'], 'lap')}, {settings['track']}, seeds from "
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


def markdown(evaluation: dict) -> str:
    """Returns evaluation.md."""
    summary, settings = evaluation["summary"], evaluation["settings"]
    parts = [f"# {_escaped(title(settings))}"]
    if not evaluation["complete"]:
        parts.append(f"Not complete: {summary['races']} of {settings['tracks']} races have ended.")
    races = [[text(race) for text in _RACES.values()] for race in evaluation["races"]]
    parts += [finish_line(summary), summary_tables(summary), _table(_RACES, races)]
    return "\n\n".join(parts) + "\n"


def summary_tables(summary: dict) -> str:
    """Returns the distributions and, if there are any, why races did not finish."""
    columns, rows = ("n", "mean", "median", "min", "max"), []
    for key, name, factor, decimals in _DISTRIBUTIONS:
        values = summary[key] or {"n": 0}
        numbers = (_number(values.get(column), decimals, factor) for column in columns[1:])
        rows.append((name, values["n"], *numbers))
    tables = [_table(("", *columns), rows)]
    if reasons := summary["dnf_reasons"]:
        tables.append(_table(("did not finish", "races"), reasons.items()))
    return "\n\n".join(tables)


def _number(value: float | None, decimals: int, factor: float = 1.0) -> str:
    return "-" if value is None else f"{factor * value:.{decimals}f}"


def _table(columns: Collection[str], rows: Sequence) -> str:
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *rows]
    return "\n".join(f"| {' | '.join(_escaped(str(cell)) for cell in line)} |" for line in lines)


def _escaped(text: str) -> str:
    """Keeps what errors and names say from ending a cell or becoming markup."""
    for character in "\\|<*`_":
        text = text.replace(character, "\\" + character)
    return " ".join(text.split())
