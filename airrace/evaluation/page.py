"""evaluation.html: all races of an evaluation, to be sorted, with what failed and how."""

import functools
import json
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from matplotlib import rc_context

from airrace.analysis.figure_style import STYLE, inline_pictures
from airrace.analysis.page_templates import page_template
from airrace.common.files import write_text
from airrace.evaluation.overview_plot import make_overview
from airrace.evaluation.store import PAGE
from airrace.evaluation.summary import dnf_class
from airrace.evaluation.tables import finish_line, title
from airrace.scenario import Scenario, scenario_yaml

_LAST_EVENTS = 6  # of an explorer whose race failed


class Column(NamedTuple):
    """A column of the table of races."""

    name: str  # its head
    meaning: str  # what it says, for who points at its head
    key: str  # of a race of evaluation.json
    factor: float = 1.0  # of numbers
    decimals: int = 0  # of numbers


COLUMNS = (
    Column("seed", "Of the race and, if it was generated, of its track.", "seed"),
    Column("gates", "How many gates the track has.", "gates"),
    Column("length (m)", "Of the way straight from gate to gate.", "length_m", decimals=1),
    Column("gates found", "How many gates the explorer found.", "gates_found"),
    Column(
        "exploration (s)",
        "From power on until the explorer had found all gates.",
        "exploration_s",
        decimals=1,
    ),
    Column("laps", "How many laps were completed.", "laps"),
    Column("mean lap (s)", "Mean of the laps that were completed.", "mean_lap_s", decimals=2),
    Column("best lap (s)", "The quickest lap.", "best_lap_s", decimals=2),
    Column(
        "map error (cm)",
        "Distance of the map's front markers from where they stand, after the last lap, root of "
        "the mean square.",
        "map_rms_m",
        factor=100.0,
        decimals=1,
    ),
    Column("collisions", "How often the drone touched something.", "collisions"),
)


def write_page(folder: Path, evaluation: dict, rows: list[dict]) -> Path:
    """Writes evaluation.html, which needs nothing else; returns its path.

    Args: evaluation: what evaluation.json holds. rows: of the races, see worker.fly().

    Raises UserError if it cannot be written.
    """
    with rc_context(STYLE):
        draw = functools.partial(make_overview, evaluation, False)
        pictures = inline_pictures(draw, "evaluation")
    settings, summary = evaluation["settings"], evaluation["summary"]
    races = [race | {"laps": len(race["lap_times_s"])} for race in evaluation["races"]]
    text = page_template("airrace.evaluation", PAGE).render(
        title=title(settings),
        complete=evaluation["complete"],
        summary=summary,
        settings=settings,
        finish_line=finish_line(summary),
        pictures=pictures,
        columns=COLUMNS,
        races=races,
        cell=_cell,
        reason_class=dnf_class,
        failures=[_failure(row, settings) for row in rows if not row["result"]["finished"]],
    )
    path = folder / PAGE
    write_text(path, text)
    return path


def _cell(race: dict, column: Column) -> str:
    """Returns what a cell of the table says."""
    value = race[column.key]
    return "–" if value is None else f"{column.factor * value:.{column.decimals}f}"


def _failure(row: dict, settings: dict) -> dict:
    """Returns what the page says of a race that did not finish."""
    result = row["result"]
    return {
        "seed": row["seed"],
        "reason": result["dnf_reason"],
        "laps": len(result["laps"]),
        "events": result["exploration"].get("events", [])[-_LAST_EVENTS:],
        "stderr": row["stderr"],
        "commands": race_commands(row["seed"], settings),
    }


def race_commands(seed: int, settings: dict) -> list[str]:
    """Returns the commands for a shell that fly a race of an evaluation again, by itself."""
    track, made = settings["track"].removeprefix("the track "), []
    if track == settings["track"]:
        track = f"track-{seed}.yaml"
        made = [f"airrace track --seed {seed} > {track}"]
    words = ["airrace", "race", "--track", track, "--seed", str(seed)]
    defaults = yaml.safe_load(scenario_yaml(Scenario()))["Defaults"]
    if fields := _differences(settings["scenario"], defaults):
        words += ["--scenario_text", json.dumps(fields)]
    return [*made, shlex.join(words)]


def _differences(fields: dict, defaults: dict) -> dict[str, Any]:
    """Returns the fields of a scenario that are not as they are by default."""
    found: dict[str, Any] = {}
    for name, value in fields.items():
        default = defaults.get(name)
        if isinstance(value, dict) and isinstance(default, dict):
            value, default = _differences(value, default), {}
        if value != default:
            found[name] = value
    return found
