"""airrace new: a drone, a track, a system, or what a league needs, which races as it is."""

import functools
import importlib.util
import keyword
import os
import re
import secrets
from pathlib import Path
from typing import Literal

from cyclopts import App

from airrace.common.command_line import typed_command
from airrace.common.errors import UserError
from airrace.common.resources import models_path

EPILOG = """\
examples:
  airrace new drone my_drone            the folder my_drone: vehicle.yaml, its SDF file, settings
  airrace new track my_track            my_track.yaml
  airrace new controller my_controller  my_controller.py, a Drake system
  airrace new detector my_detector      my_detector.py, a Drake system
  airrace new entry my_entry            the folder my_entry, to take part in a league
  airrace new season my_season          my_season.yaml, and my_season.seed, its secret

Each prints the command that races it."""


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(new, help_epilogue=EPILOG)


def new(
    kind: Literal["drone", "track", "controller", "detector", "entry", "season"], name: str, /
) -> int:
    """Make a file or a folder of your own to begin with, which races as it is.

    Args:
        kind: of what you want to make
        name: of it, and of its file or folder in the working directory
    """
    makers = {"drone": _drone, "track": _track, "entry": _entry, "season": _season}
    command = makers.get(kind, _system)(kind, name)
    print(f"Race it with:\n  {typed_command()} {command}")
    return 0


def _drone(kind: str, name: str) -> str:
    """Makes the folder of a drone; returns the subcommand that races it."""
    _check_name(name)
    source = models_path() / "default"
    vehicle = (source / "vehicle.yaml").read_text(encoding="utf-8")
    first = f"# The drone {name}, from the default quadrotor. Keep mass and inertia as in the SDF."
    vehicle = re.sub(r"\A#.*", first, vehicle)
    vehicle = vehicle.replace("name: Default", f"name: {name}")
    vehicle = vehicle.replace("model: default.sdf ", f"model: {name}.sdf ")
    sdf = (source / "default.sdf").read_text(encoding="utf-8")
    betaflight = (source / "betaflight.txt").read_text(encoding="utf-8")
    betaflight = betaflight.replace("drone Default", f"drone {name}")
    files = {"vehicle.yaml": vehicle, f"{name}.sdf": sdf, "betaflight.txt": betaflight}
    _write({Path(name, file): text for file, text in files.items()})
    return f"race -d ./{name} --track hexagon --laps 1"


def _track(kind: str, name: str) -> str:
    """Makes the file of a track; returns the subcommand that races it."""
    _check_name(name)
    text = (models_path() / "templates" / "track.yaml").read_text(encoding="utf-8")
    _write({Path(f"{name}.yaml"): text.replace("NAME", name)})
    return f"race --track {name}.yaml --laps 1"


def _entry(kind: str, name: str) -> str:
    """Makes the folder of an entry of a league; returns the subcommand that checks it."""
    _check_name(name)
    templates = sorted((models_path() / "templates" / "entry").iterdir())
    _write(
        {
            Path(name, path.name): path.read_text(encoding="utf-8").replace("NAME", name)
            for path in templates
            if path.is_file()
        }
    )
    return f"league check {name}"


def _season(kind: str, name: str) -> str:
    """Makes the file of a season and its secret seed; returns the subcommand that flies it."""
    _check_name(name)
    text = (models_path() / "templates" / "season.yaml").read_text(encoding="utf-8")
    secret = f"{secrets.token_hex(16)}\n"
    files = {Path(f"{name}.yaml"): text.replace("NAME", name), Path(f"{name}.seed"): secret}
    _write(files, secret=Path(f"{name}.seed"))
    return f"league run {name}.yaml original optimal"


def _system(kind: str, name: str) -> str:
    """Makes the module of a system; returns the subcommand that races it."""
    if not name.isidentifier() or keyword.iskeyword(name):
        raise UserError(f"'{name}' cannot be a Python module; use letters, digits and _ only.")
    if importlib.util.find_spec(name) is not None:
        raise UserError(f"There is a Python module '{name}' already; take another name.")
    text = (models_path() / "templates" / f"{kind}.py").read_text(encoding="utf-8")
    text = text.replace("NAME", name)
    _write({Path(f"{name}.py"): text})
    command = next(line for line in text.splitlines() if "airrace race" in line)
    return command.strip().removeprefix("airrace ")


def _check_name(name: str) -> None:
    if not re.fullmatch(r"\w[\w-]*", name, re.ASCII):
        raise UserError(f"'{name}' cannot be a name here; use letters, digits, _ and - only.")


def _write(texts: dict[Path, str], secret: Path | None = None) -> None:
    """Writes new files, and says which.

    Args:
        texts: what each is to hold.
        secret: the one of them that only its owner may read, from its first byte on.

    Raises:
        UserError: if there is one already, or it cannot be written.
    """
    for path, text in texts.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            mode = 0o600 if path == secret else 0o666  # of which the umask takes its part
            opener = functools.partial(os.open, mode=mode)
            with open(path, "x", encoding="utf-8", opener=opener) as file:
                file.write(text)
        except FileExistsError:
            raise UserError(f"There is {path} already; take another name.") from None
        except OSError as e:
            raise UserError(
                f"{path} cannot be written ({e.strerror}); go to a folder of yours."
            ) from None
        print(path)
