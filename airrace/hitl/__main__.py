"""`python -m airrace.hitl autonomy`: a side of a race with hardware in the loop."""

import sys

from airrace.common.command_line import make_app, run_app
from airrace.common.version import VERSION
from airrace.hitl.command import add_to

app = make_app("airrace", VERSION, "A side of a race with hardware in the loop.", add_to)
sys.exit(run_app(app, ["hitl", *sys.argv[1:]]))
