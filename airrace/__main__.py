"""python -m airrace: the same as the command `airrace`."""

import sys

from airrace.common.python_path import forget_working_folder

forget_working_folder()  # before anything else is imported: it might come from there

from airrace.commands.app import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
