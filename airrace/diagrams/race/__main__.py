"""`python -m airrace.diagrams.race`: races with everything in this process."""

import sys

from airrace.common.command_line import make_app, run_app
from airrace.common.version import VERSION
from airrace.diagrams.race_command import add_to

app = make_app("airrace", VERSION, "A race, with everything in one process.", add_to)
sys.exit(run_app(app, ["race", *sys.argv[1:]]))
