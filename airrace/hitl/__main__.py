"""`python -m airrace.hitl autonomy`: a side of a race with hardware in the loop."""

import os
import sys

from airrace.common.python_path import forget_working_folder

forget_working_folder()  # before anything else is imported: it might come from there

from airrace.common.command_line import make_app, run_app  # noqa: E402
from airrace.common.processes import stopped_with  # noqa: E402
from airrace.common.version import VERSION  # noqa: E402
from airrace.hitl.command import add_to  # noqa: E402
from airrace.hitl.companion import PARENT  # noqa: E402

if parent := os.environ.pop(PARENT, None):
    stopped_with(int(parent))
app = make_app("airrace", VERSION, "A side of a race with hardware in the loop.", add_to)
sys.exit(run_app(app, ["hitl", *sys.argv[1:]]))
