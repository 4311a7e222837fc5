"""Writing results so that a reader never sees half a file."""

import json
import os
from pathlib import Path


def write_text(path: Path, text: str) -> None:
    """Replaces a file at once: readers see the old text or the new one."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text)
    temporary.replace(path)


def write_json(path: Path, data) -> None:
    """Writes JSON for people and programs; NaN is an error, as JSON has none."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")
