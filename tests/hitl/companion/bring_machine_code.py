"""Copies the machine code of a checkout to an airrace that was brought to a companion.

bring_machine_code.py CHECKOUT PACKAGE: the folders in which each has its airrace/.
"""

import shutil
import sys
from pathlib import Path


def bring(checkout: Path, package: Path) -> None:
    """Copies it, unless there is some already.

    Args:
        checkout: whose machine code to copy, if it has any.
        package: the same sources elsewhere.
    """
    target = package / "airrace/__pycache__"
    if not (package / "complete").exists() or list(target.glob("machine_code-*")):
        return
    for code in (checkout / "airrace/__pycache__").glob("machine_code-*"):
        shutil.copytree(code, target / code.name)


if __name__ == "__main__":
    bring(Path(sys.argv[1]), Path(sys.argv[2]))
