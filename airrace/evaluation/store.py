"""The folder of an evaluation: settings, and one line of JSON a race that ended."""

import fcntl
import itertools
import json
import os
from pathlib import Path
from typing import Any, ClassVar, Self, TypedDict, cast

from airrace.common.errors import UserError
from airrace.common.files import EVALUATION, write_json
from airrace.common.json_files import parse_json, read_json

# What an evaluation leaves in its folder.
RACES, SUMMARY, TABLE, PICTURE, PAGE = FILES = EVALUATION


class _Nothing:
    """Stands in the place of what is not there."""

    def __repr__(self) -> str:
        return "nothing"


_NOTHING = _Nothing()


class _ExplorationJson(TypedDict):
    success: bool
    time_s: float | None
    gates_found: int


class _LapJson(TypedDict):
    time_s: float
    map_rms_m: float | None


class _ResultJson(TypedDict):
    finished: bool
    dnf_reason: str | None
    exploration: _ExplorationJson
    laps: list[_LapJson]
    mean_lap_s: float | None
    best_lap_s: float | None
    collisions: int


class RowJson(TypedDict):
    """A line of races.jsonl; see fly()."""

    seed: int
    gates: int
    length_m: float
    result: _ResultJson
    stderr: str | None


class _SettingsJson(TypedDict):
    settings: dict[str, object]


class RaceStore:
    """Keeps the rows of races, each on disk before the next one is taken.

    The rows' file gets a whole line for every race. The last line may be torn by a crash; it is
    removed when the evaluation is resumed, and its race is flown again. One process at a time
    writes to a folder. As a context manager it takes its files away when UserError ends it before
    the first row: then nothing has been evaluated. What others keep in this way, they name in a
    class of their own.

    Attributes:
        key: of a row, by which races are told apart.
        files: names of the rows' file, of the file with the settings, and of what else there is.
        what: is kept, in a sentence.
        row: the schema of a row.
    """

    key: ClassVar[str] = "seed"
    files: ClassVar[tuple[str, ...]] = FILES
    what: ClassVar[str] = "evaluation"
    row: ClassVar[type] = RowJson

    def __init__(self, folder: Path, settings: dict, *, resume: bool = False):
        """Opens an existing folder, and writes the settings to the file that is for them.

        Args:
            settings: plain data; equal for the same evaluation.
            resume: whether to go on with what is in the folder.

        Raises:
            UserError: if there is an evaluation and it is not to be resumed or has other settings,
                if another process writes to it, or if its files cannot be read or written.
        """
        self._folder, self._path = folder, folder / self.files[0]
        self._settings = folder / self.files[1]
        self._rows = {}
        self._check_settings(settings, resume)
        self._is_new = not self._path.exists()
        try:
            self._file = open(self._path, "a+b")
        except OSError as e:
            raise UserError(
                f"{self._path} cannot be written ({e.strerror}); make it writable."
            ) from None
        try:
            self._lock()
            self._load()
            if not self._settings.exists():
                write_json(self._settings, {"complete": False, "settings": settings})
            _sync(folder)
        except BaseException:
            self._file.close()
            raise

    @property
    def rows(self) -> list[dict]:
        """The rows so far, ordered by their keys."""
        return [self._rows[key] for key in sorted(self._rows)]

    @property
    def keys(self) -> set:
        """The keys of the races that have ended."""
        return set(self._rows)

    def append(self, row: dict) -> None:
        """Keeps the row of a race; it is on the disk when this returns.

        Raises UserError if it cannot be written.
        """
        if row[self.key] in self._rows:
            raise ValueError(f"the race with {self.key} {row[self.key]} has ended before")
        end = self._file.seek(0, os.SEEK_END)
        try:
            self._file.write(json.dumps(row, allow_nan=False).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as e:
            self._truncate(end)
            raise UserError(
                f"{self._path} cannot be written ({e.strerror}); make room there "
                "and go on with --resume."
            ) from None
        self._rows[row[self.key]] = row

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if self._is_new and not self._rows and isinstance(error, UserError):
            for name in self.files[:2]:
                (self._folder / name).unlink(missing_ok=True)
        self._file.close()

    def _lock(self):
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UserError(
                f"Another {self.what} is writing to {self._folder}; wait for its end or name "
                "another folder."
            ) from None

    def _load(self):
        self._file.seek(0)
        content = self._file.read()
        *lines, torn = content.split(b"\n")
        for number, line in enumerate(lines, 1):
            try:
                row = cast(dict, parse_json(line, self.row))
                self._rows.setdefault(row[self.key], row)
            except ValueError as e:
                raise UserError(
                    f"Line {number} of {self._path} is not the row of a race: {e}; remove the "
                    "line, and --resume flies that race again."
                ) from None
        self._truncate(len(content) - len(torn))

    def _truncate(self, size):
        os.ftruncate(self._file.fileno(), size)
        os.fsync(self._file.fileno())

    def _check_settings(self, settings, resume):
        folder, path, races = self._folder, self._settings, self._path
        if not resume:
            if any(os.path.lexists(folder / name) for name in self.files):
                raise UserError(
                    f"--output {folder} already holds {self._a_what()}; go on with it by --resume, "
                    "or name another folder."
                )
            return
        if not path.exists():
            if not races.exists() or races.stat().st_size == 0:
                return
            raise UserError(
                f"--resume: {path} is missing, which tells what {races.name} holds; name another "
                "folder."
            )
        try:
            what, remedy = f"file with the settings of {self._a_what()}", "name another folder"
            before = read_json(path, _SettingsJson, what, remedy)["settings"]
        except UserError as e:
            raise UserError(f"--resume: {e}") from None
        # As JSON has it: tuples are lists.
        difference = first_difference(before, json.loads(json.dumps(settings)))
        if difference:
            name, old, new = difference
            raise UserError(
                f"--resume: {folder} holds {self._a_what()} with {name} {old}, not {new}; do as "
                "you did before, or name another folder."
            )

    def _a_what(self):
        return f"a{'n' * (self.what[0] in 'aeiou')} {self.what}"


def _sync(folder):
    """Makes new names in a folder survive a loss of power."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def first_difference(a: Any, b: Any, name: str = "") -> tuple | None:
    """Returns the dotted name and the two values where plain data first differs, or None."""
    if isinstance(a, dict) and isinstance(b, dict):
        parts = ((a.get(k, _NOTHING), b.get(k, _NOTHING), f".{k}") for k in {**a, **b})
    elif isinstance(a, list) and isinstance(b, list):
        pairs = enumerate(itertools.zip_longest(a, b, fillvalue=_NOTHING))
        parts = ((each, other, f"[{i}]") for i, (each, other) in pairs)
    else:
        is_same = type(a) is type(b) and a == b  # True is 1 in Python, and not in JSON
        return None if is_same else (name, a, b)
    found = (first_difference(x, y, f"{name}{part}".lstrip(".")) for x, y, part in parts)
    return next(filter(None, found), None)
