"""Copies the machine code of a checkout to an airrace that was brought to a companion.

bring_machine_code.py CHECKOUT PACKAGE: the folders in which each has its airrace/. Numba keeps the
machine code of a file in a folder named after the file's own folder, and takes it only if the file
has the time of change that it had; so both become those of the airrace that was brought.
"""

import hashlib
import os
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
    sources = sorted((checkout / "airrace").rglob("*.py"))
    names = {_numbas_name(each.parent): each.parent.relative_to(checkout) for each in sources}
    for source in sources:
        times = source.stat().st_atime_ns, source.stat().st_mtime_ns
        os.utime(package / source.relative_to(checkout), ns=times)
    for code in (checkout / "airrace/__pycache__").glob("machine_code-*"):
        for entry in sorted(code.iterdir()):
            there = target / code.name
            if entry.name in names:
                there /= _numbas_name(package / names[entry.name])
                shutil.copytree(entry, there)
            elif entry.suffix == ".complete":
                shutil.copy(entry, there)


def _numbas_name(folder: Path) -> str:
    return f"{folder.name}_{hashlib.sha1(str(folder).encode()).hexdigest()}"


if __name__ == "__main__":
    bring(Path(sys.argv[1]), Path(sys.argv[2]))
