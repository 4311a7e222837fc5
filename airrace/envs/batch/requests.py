"""What a caller asks of a batch of drones, checked before machine code sees it."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from airrace.common.errors import UserError
from airrace.envs.options import check_names, checked_options

_KNOWN = ("tracks", "reset_mask")


class ResetRequest(NamedTuple):
    """Which drones begin anew, and where."""

    drones: np.ndarray  #: their numbers, (k,)
    tracks: np.ndarray | None  #: index of the track of each of all drones, (N,); None: drawn


def reset_request(options: Mapping[str, Any] | None, count: int, tracks: int) -> ResetRequest:
    """Returns what the options of reset() ask for.

    Args:
        options: ``tracks``, the index of the track of each drone, (count,); ``reset_mask``, whether
            it begins anew, (count,) of bool, as Gymnasium has it.
        count: of drones. tracks: how many there are.

    Raises:
        UserError: for an option that there is not.
        TypeError: if the mask is no array of bool, as of Gymnasium's own environments.
        ValueError: if an option has another shape, or a track is none of those that there are.
    """
    options = checked_options(options)
    check_names(options, _KNOWN, "reset() has no option")
    mask = options.get("reset_mask")
    drones = np.arange(count) if mask is None else np.flatnonzero(_mask(mask, count))
    wanted = options.get("tracks")
    return ResetRequest(drones, None if wanted is None else _indices(wanted, count, tracks))


def autoreset_mode(value: AutoresetMode | str) -> AutoresetMode:
    """Returns a mode of Gymnasium by its value or its name: ``"SameStep"`` or ``"SAME_STEP"``.

    Raises:
        UserError: if there is none.
    """
    for mode in AutoresetMode:
        if value in (mode, mode.value, mode.name):
            return mode
    names = ", ".join(AutoresetMode.__members__)
    raise UserError(f"autoreset_mode must be one of {names}, not {value!r}.")


def _mask(mask: Any, count: int) -> np.ndarray:
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"reset_mask must be an array of bool of numpy, not {mask!r}.")
    if mask.shape != (count,) or not mask.any():
        raise ValueError(
            f"reset_mask must have the shape ({count},) and one True or more, not {mask}."
        )
    return mask


def _indices(wanted: Iterable[int], count: int, tracks: int) -> np.ndarray:
    try:
        result = np.asarray(wanted)
    except ValueError:  # of rows of different lengths
        result = np.empty(0, object)
    if result.shape != (count,) or not np.issubdtype(result.dtype, np.integer):
        raise ValueError(
            f"tracks must be {count} whole numbers, the index of a track for each drone, "
            f"not {wanted!r}."
        )
    if not np.all((result >= 0) & (result < tracks)):
        raise ValueError(f"tracks must be from 0 to {tracks - 1}, not {wanted!r}.")
    return result
