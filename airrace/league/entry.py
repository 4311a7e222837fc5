"""An entry: the folder with which a team takes part, and what must be so for it to fly."""

import ast
import dataclasses as dc
import functools
import importlib.metadata
import re
import sys
from importlib.machinery import PathFinder
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.files import digest, files_in
from airrace.common.resources import load_yaml, models_path
from airrace.common.words import printable
from airrace.diagrams.variants import SYSTEM_NAMES
from airrace.league.league_json import NAME
from airrace.scenario import (
    LEARNED,
    NO_POLICY,
    ControllerConfig,
    ExplorerConfig,
    PerceptionConfig,
    PlannerConfig,
    Scenario,
    StateFilterConfig,
)
from airrace.vehicle import DRONES

ENTRY_FILE = "entry.yaml"
MAX_SIZE = 50e6  # bytes of all files
_MAX_FILES = 2000
_MAX_RATE = 1000.0  # Hz: the plant's own


@dc.dataclass
class AutonomyConfig:
    """The part of a scenario that belongs to an entry; see the scenario for what each means.

    Latencies are not the entry's: they stand for the computer that all entries fly on.
    """

    OLD_NAMES = Scenario.OLD_NAMES

    trajectory: str = "optimal"
    estimator: str = ""  # "truth" or "vio"; by default, what the season gives
    policy: str = NO_POLICY  # or "learned"; or a file of the entry's folder
    perception: PerceptionConfig = dc.field(default_factory=PerceptionConfig)
    explorer: ExplorerConfig = dc.field(default_factory=ExplorerConfig)
    planner: PlannerConfig = dc.field(default_factory=PlannerConfig)
    state_filter: StateFilterConfig = dc.field(default_factory=StateFilterConfig)
    controller: ControllerConfig = dc.field(default_factory=ControllerConfig)


@dc.dataclass
class EntryConfig:
    """What entry.yaml says."""

    team: str = ""  # as the page calls it
    drone: str = "Default"  # one of those that the season allows
    # A system's name to "module:callable", of a file in the folder; see docs/own_systems.md.
    systems: dict[str, str] = dc.field(default_factory=dict)
    autonomy: AutonomyConfig = dc.field(default_factory=AutonomyConfig)
    # Python packages that the code imports beside airrace's own, by name and version.
    packages: dict[str, str] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True)
class Entry:
    """An entry whose files are sound."""

    name: str  # of its folder; results are filed under it
    folder: Path  # with its files
    config: EntryConfig  # of entry.yaml
    digest: str  # of all files

    @functools.cached_property
    def files(self) -> dict[str, bytes]:
        """Contents of all files by relative names."""
        return {
            path.relative_to(self.folder).as_posix(): path.read_bytes()
            for path in files_in(self.folder)
        }


def load_entry(name_or_folder: str | Path) -> Entry:
    """Returns an entry: a folder, or a shipped one by name.

    Nothing of its code is run.

    Raises:
        UserError: with one sentence on the first thing for which it is not accepted.
    """
    folder = find_entry(name_or_folder)
    name = folder.resolve().name
    if not re.fullmatch(NAME, name, re.ASCII):
        raise UserError(
            f"The entry's folder '{name}' needs another name, of letters, digits, _ and - only."
        )
    if _is_module(name):
        raise UserError(
            f"The entry's folder '{name}' has the name of a module of Python's, which might be "
            "taken for it; give it another name."
        )
    _check_files(folder)
    config = load_yaml(EntryConfig, filename=folder / ENTRY_FILE)
    _check_config(folder / ENTRY_FILE, config)
    _check_systems(folder, config)
    _check_packages(folder / ENTRY_FILE, config)
    # Of what is in the folder: the digest does not depend on the folder's name.
    return Entry(name, folder, config, digest(*sorted(folder.iterdir())))


def _is_module(name: str) -> bool:
    """Whether a module of that name can be imported here; nothing of it is run."""
    spec = PathFinder.find_spec(name)
    return name in sys.stdlib_module_names or (spec is not None and spec.origin is not None)


def find_entry(name_or_folder: str | Path) -> Path:
    """Returns the folder of an entry; see load_entry()."""
    shipped = models_path() / "entries"
    for folder in (Path(name_or_folder), shipped / name_or_folder):
        if (folder / ENTRY_FILE).is_file():
            return folder
    names = ", ".join(sorted(path.name for path in shipped.iterdir() if path.is_dir()))
    raise UserError(
        f"There is no entry '{name_or_folder}': it must be a folder with an {ENTRY_FILE} "
        f"('airrace new entry NAME' makes one), or one of those that are shipped: {names}."
    )


def _check_files(folder: Path) -> None:
    for path in sorted(filter(Path.is_symlink, folder.rglob("*"))):
        raise UserError(
            f"{path} is a symbolic link: an entry brings its files itself; copy the file."
        )
    files = files_in(folder)
    size = sum(path.stat().st_size for path in files)
    if size > MAX_SIZE or len(files) > _MAX_FILES:
        raise UserError(
            f"The entry {folder} has {len(files)} files of {size / 1e6:.0f} MB: at most "
            f"{_MAX_FILES} and {MAX_SIZE / 1e6:.0f} MB are accepted; remove what it does not need."
        )
    for path in files:
        if path.suffix != ".py":
            continue
        try:
            ast.parse(path.read_bytes(), filename=str(path))
        except SyntaxError as e:
            raise UserError(
                f"{path} is no Python: {e.msg} at line {e.lineno}; correct it and check again."
            ) from None
        except (ValueError, RecursionError, MemoryError) as e:  # null bytes; nested too deeply
            raise UserError(f"{path} is no Python: {e}; correct it and check again.") from None


def _check_config(path: Path, config: EntryConfig) -> None:
    autonomy = config.autonomy
    if not config.team.strip() or len(config.team) > 60 or config.team != printable(config.team):
        raise UserError(f"{path}: team must be a name of 1 to 60 characters that are seen.")
    if config.drone not in DRONES:
        raise UserError(
            f"{path}: drone must be a shipped one, {' or '.join(DRONES)}, not '{config.drone}'."
        )
    if autonomy.policy not in (NO_POLICY, LEARNED) and not _is_inside(path.parent, autonomy.policy):
        raise UserError(
            f"{path}: autonomy.policy must be none, learned, or a file of the entry's folder, "
            f"not '{autonomy.policy}'."
        )
    for part, default in (("perception", PerceptionConfig()), ("planner", PlannerConfig())):
        if getattr(autonomy, part).latency != default.latency:
            raise UserError(
                f"{path}: autonomy.{part}.latency is {default.latency:g} s for all entries; leave "
                "it out."
            )
    for part in ("explorer", "planner", "state_filter", "controller"):
        if getattr(autonomy, part).rate > _MAX_RATE:
            raise UserError(f"{path}: autonomy.{part}.rate must be at most {_MAX_RATE:g} Hz.")


def _is_inside(folder: Path, name: str) -> bool:
    path = (folder / name).resolve()
    return path.is_file() and path.is_relative_to(folder.resolve())


def _check_systems(folder: Path, config: EntryConfig) -> None:
    for name, path in config.systems.items():
        if name not in SYSTEM_NAMES:
            raise UserError(
                f"{folder / ENTRY_FILE}: systems.{name} is not a system of the autonomy; there "
                f"are: {', '.join(SYSTEM_NAMES)}."
            )
        module, colon, attribute = path.partition(":")
        top = module.partition(".")[0]
        if not colon or not attribute:
            raise UserError(
                f"{folder / ENTRY_FILE}: systems.{name} must be module:callable, not '{path}'."
            )
        places = folder / f"{top}.py", folder / top / "__init__.py"
        if top != "airrace" and not any(place.is_file() for place in places):
            raise UserError(
                f"{folder / ENTRY_FILE}: systems.{name} names the module '{top}', and there is no "
                f"{top}.py in the folder."
            )


def _check_packages(path: Path, config: EntryConfig) -> None:
    for name, version in config.packages.items():
        try:
            there = importlib.metadata.version(name)
        except (importlib.metadata.PackageNotFoundError, ValueError):
            raise UserError(
                f"{path}: the package {name} {version} is not installed here; whoever runs the "
                f"league installs it (python -m pip install {name}=={version}), or the entry does "
                "without."
            ) from None
        if there != version:
            raise UserError(
                f"{path}: the package {name} is here in version {there}, not {version}; adapt "
                "the entry, or have that version installed."
            )
