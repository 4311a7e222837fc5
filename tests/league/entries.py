"""Entries to test with."""

from pathlib import Path

ENTRY_YAML = "team: Herons\n"


def make_entry(folder: Path, entry_yaml: str = ENTRY_YAML, **files: str) -> Path:
    """Writes the folder of an entry; files: text by name, without .py."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "entry.yaml").write_text(entry_yaml)
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder
