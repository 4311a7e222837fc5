"""Tracks from their files, whatever kind of gates they have."""

import functools
import os
from pathlib import Path
from typing import Literal, overload

import yaml

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml, load_yaml
from airrace.common.strict_yaml import plain_data, read_yaml
from airrace.track.course import Course
from airrace.track.square_track import SQUARE, SquareTrack
from airrace.track.track import Track


@overload
def load_track(name_or_file: str | os.PathLike[str], *, markers: Literal[True]) -> Track: ...


@overload
def load_track(name_or_file: str | os.PathLike[str], *, markers: bool = False) -> Course: ...


def load_track(name_or_file: str | os.PathLike[str], *, markers: bool = False) -> Course:
    """Loads and checks a track.

    Args:
        name_or_file: the name of a shipped track or the path of a YAML file.
        markers: whether its gates must have markers: the autonomy finds no others.

    Raises:
        UserError: if it is missing, malformed or impossible to fly, or has no markers.
    """
    path = find_yaml("tracks", name_or_file)
    # Kept, because both diagrams of a race load the track, and the checks take a while.
    course = _load_track(path, path.stat().st_mtime_ns)
    if markers and not course.has_markers:
        raise UserError(
            f"The track {path} has square gates, which have no markers to find: fly it with "
            f"`airrace grand-prix --track {name_or_file}`, or take a track of pylons."
        )
    return course


@functools.lru_cache(maxsize=8)
def _load_track(path: Path, _mtime: int) -> Course:
    return checked_track(load_yaml(_kind_of(path), filename=path), str(path))


def checked_track[T: Course](course: T, where: str) -> T:
    """Returns a track that can be raced; where: the file that it is from.

    Raises:
        UserError: if it cannot be raced.
    """
    try:
        course.check()
    except ValueError as e:
        raise UserError(f"The track {where} cannot be raced: {e}.") from None
    return course


def _kind_of(path: Path) -> type[Course]:
    """Returns the class that a track's file is of; without ``gate``, its gates are pylons."""
    try:
        data = plain_data(read_yaml(str(path), filename=path))
    except yaml.YAMLError:
        return Track  # whoever loads it says what is wrong
    gate = data.get("gate") if isinstance(data, dict) else None
    if gate is None:
        return Track
    if isinstance(gate, dict) and gate.get("kind") == SQUARE:
        return SquareTrack
    raise UserError(
        f"The track {path} has gates of an unknown kind: write gate: {{kind: {SQUARE}}}, or leave "
        "gate out for pylons."
    )
