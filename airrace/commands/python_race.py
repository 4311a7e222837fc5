"""airrace.race(): a race from Python, in one line."""

import dataclasses as dc
import difflib
import json
from pathlib import Path
from typing import Any

from airrace.analysis.run import Run, load_run
from airrace.commands.race import AnyRaceOptions, fly_any
from airrace.common.errors import UserError
from airrace.common.plain_values import plain_tree


def race(*, fields: dict | None = None, quiet: bool = False, **options: Any) -> Run:
    """Flies a race and returns what it left.

    For example ``airrace.race(track="hexagon", laps=2)``, or
    ``airrace.race(track="hexagon", fields={"explorer": {"max_speed": 4.0}})``.

    Args:
        fields: of the scenario, those that no option is for; as of --scenario_text.
        quiet: whether to print nothing while it flies.
        **options: those of the command ``airrace race``, see AnyRaceOptions; here, ``meshcat``
            and ``report`` are False, and ``linger`` is 0, unless you say otherwise.

    Returns:
        the run; ``run.result["finished"]`` says whether the drone finished.

    Raises:
        UserError: on bad input, with the remedy.
    """
    names = [field.name for field in dc.fields(AnyRaceOptions)]
    for name in options:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f"do you mean '{near[0]}'?" if near else f"there are: {', '.join(names)}."
            raise UserError(f"A race has no option '{name}'; {hint}")
    if fields is not None:
        if "scenario_text" in options:
            raise UserError("fields and scenario_text say the same: leave one out.")
        options["scenario_text"] = json.dumps(plain_tree("fields", fields))  # which is YAML, too
    for name in ("output", "graphviz", "identity", "wheels"):
        if options.get(name) is not None:
            options[name] = Path(options[name])
    if options.get("trajectory") is not None:
        options["trajectory"] = str(options["trajectory"])
    defaults = {"meshcat": False, "report": False, "linger": 0.0}
    _, folder = fly_any(AnyRaceOptions(**{**defaults, **options}), quiet=quiet)
    return load_run(folder)
