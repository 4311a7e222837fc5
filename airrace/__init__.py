"""airrace: autonomous drone racing on Drake, without ROS.

What a lesson needs is here: ``airrace.race``, ``load_run``, ``load_scenario``,
``load_track``, ``load_vehicle``, ``generate_track``, ``show_runs``, ``show_page``,
``write_report`` and ``UserError``.
"""

import importlib
import sys

# pip refuses an older Python, a checkout on its path does not; so that it can read this file,
# there are no f-strings.
if sys.version_info < (3, 12):  # noqa: UP036
    sys.stderr.write(
        "airrace: this is Python " + sys.version.split()[0] + ", and airrace needs 3.12 or "
        "newer: ./run.bash of a checkout finds or installs one.\n"
    )
    sys.exit(2)

from airrace.common.version import VERSION as __version__  # noqa: E402

# Not of the module typing, which is a file: see airrace/common/python_path.py.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from airrace.analysis import load_run
    from airrace.analysis.report import write_report
    from airrace.commands.python_race import race
    from airrace.common.errors import UserError
    from airrace.scenario import load_scenario
    from airrace.track import load_track
    from airrace.track.generator import generate_track
    from airrace.vehicle import load_vehicle
    from airrace.visualization.inline import show_page, show_runs

# Where each name is. It is imported when it is first asked for: Drake takes a second.
_PLACES = {
    "UserError": "airrace.common.errors",
    "generate_track": "airrace.track.generator",
    "load_run": "airrace.analysis",
    "load_scenario": "airrace.scenario",
    "load_track": "airrace.track",
    "load_vehicle": "airrace.vehicle",
    "race": "airrace.commands.python_race",
    "show_page": "airrace.visualization.inline",
    "show_runs": "airrace.visualization.inline",
    "write_report": "airrace.analysis.report",
}
__all__ = [*_PLACES, "__version__"]


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError("module 'airrace' has no attribute %r" % name)  # noqa: UP031
    value = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted([*globals(), *_PLACES])
