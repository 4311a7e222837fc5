"""python -m airrace: the same as the command `airrace`."""

import sys

if sys.platform in ("win32", "cygwin"):  # Drake has no wheels for it
    sys.stderr.write(
        "airrace: airrace does not run on Windows itself: install and run it in WSL2, see "
        "https://learn.microsoft.com/windows/wsl/install.\n"
    )
    sys.exit(2)

from airrace.common.python_path import forget_working_folder

forget_working_folder()  # before anything else is imported: it might come from there

from airrace.commands.app import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
