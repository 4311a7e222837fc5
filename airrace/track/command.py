"""airrace track: a random race track as YAML."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from airrace.common.command_line import Whole
from airrace.common.errors import UserError

if TYPE_CHECKING:
    from airrace.track import Course

_EPILOG = """\
Every track obeys the layout rule of the Student AirRace: the next left pylon is
straight ahead of the left pylon, 12 to 70 m away, and every gate is turned by 45
degrees from the one before. The turns add up to one round, which takes an even
number of gates, 8 at least. The drone has room between the pylons, and sees each
gate on its way straight on from the one before.

With --kind square it is a course for airrace grand-prix: square gates of 1.5 m,
winding through a dark hall, with climbs and descents, about 200 m for 17 to 20 gates.
With --kind straight it has 6 of them and hardly turns.

examples:
  airrace track --seed 7 > seven.yaml                    anything
  airrace track --seed 7 --gates 10 --plot seven.png > seven.yaml
  airrace track --seed 7 --direction right > seven.yaml  clockwise
  airrace race --track seven.yaml                        race it
  airrace track --kind square --seed 7 --gates 10 > square.yaml

The same options give the same file. Exit codes: 0 printed, 2 bad input."""


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(track, help_epilogue=_EPILOG)


def track(
    *,
    seed: Whole = 0,
    gates: Whole | None = None,
    direction: Literal["left", "right"] | None = None,
    kind: Literal["pylons", "square", "straight"] = "pylons",
    plot: Annotated[Path | None, Parameter(metavar="FILE")] = None,
) -> int:
    """Print a random race track as YAML.

    Args:
        seed: which of the random tracks, 0 or more (default: 0)
        gates: how many: 8, 10, ... or 20; of square ones 2 to 20 (default: drawn from the seed)
        direction: of travel: left is counter-clockwise (default: drawn from the seed)
        kind: pylons with markers, square frames, or square frames nearly in line (default: pylons)
        plot: also draw it from above, as .png, .svg or .pdf
    """
    from airrace.track.generator import generate_square_track, generate_track
    from airrace.track.layout import Layout

    made: Course
    if kind != "pylons":
        if direction is not None:
            raise UserError("--direction is for tracks of pylons: leave it out.")
        made = generate_square_track(seed, gates, straight=kind == "straight")
        command = f"airrace track --kind {kind} --seed {seed} --gates {len(made.gates)}"
    else:
        made = generate_track(seed, gates, direction)
        way = "left" if Layout.of(made).turns.sum() > 0 else "right"
        command = f"airrace track --seed {seed} --gates {len(made.gates)} --direction {way}"
    if plot is not None:
        from airrace.track.plot import save_plot  # matplotlib takes a second

        save_plot(made, plot)
    sys.stdout.write(to_yaml(made, command))
    return 0


def to_yaml(track: "Course", comment: str) -> str:
    """Returns the text of a track's file, which begins with a comment."""
    from pydrake.common.yaml import yaml_dump_typed

    return f"# {comment}\n{track.notes}{yaml_dump_typed(track, schema=type(track))}"
