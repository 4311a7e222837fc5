"""python -m airrace: the same as the command `airrace`."""

import sys

from airrace.commands.app import main

sys.exit(main())
