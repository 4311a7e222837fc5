"""What an autonomy knows, on disk, so that another process can go on with it."""

import pickle
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.common.errors import UserError, words
from airrace.common.files import write_bytes

if TYPE_CHECKING:
    from pydrake.systems.framework import Context, Diagram

CHECKPOINT = "checkpoint.pickle"
CHECKPOINT_PERIOD = 1.0  # s


def states_of(part: "Diagram", root_context: "Context") -> dict[str, tuple[list, list]]:
    """Returns the discrete and the abstract state of each system of a diagram, by its name.

    Args: part: the autonomy, or a half of it. root_context: of the diagram around it.
    """
    states = {}
    for system in part.GetSystems():
        context = system.GetMyContextFromRoot(root_context)
        groups, values = context.num_discrete_state_groups(), context.num_abstract_states()
        states[system.get_name()] = (
            [context.get_discrete_state(i).CopyToVector() for i in range(groups)],
            [context.get_abstract_state(i).get_value() for i in range(values)],
        )
    return states


def save(folder: Path, race: str, states: dict) -> None:
    """Writes CHECKPOINT: the identity of the race, and the states of all systems of an autonomy."""
    write_bytes(folder / CHECKPOINT, pickle.dumps((race, states)))


def race_of(folder: Path) -> str:
    """Returns the identity of the race that a checkpoint is of; see restore()."""
    return _load(folder)[0]


def restore(folder: Path, part: "Diagram", root_context: "Context") -> None:
    """Gives the systems of a diagram the states that save() has written.

    Only of folders whose owner you trust: a pickle can run code.

    Args: folder: see save(). The others: see states_of().

    Raises UserError if there is none, or it is another autonomy's.
    """
    _, states = _load(folder)
    try:
        for system in part.GetSystems():
            discrete, abstract = states[system.get_name()]
            context = system.GetMyMutableContextFromRoot(root_context)
            for i, value in enumerate(discrete):
                context.SetDiscreteState(i, value)
            for i, value in enumerate(abstract):
                context.SetAbstractState(i, value)
    except Exception as e:  # other systems may raise anything
        raise _unfit(folder, e) from None


def _load(folder: Path) -> tuple[str, dict]:
    """Returns what save() has written; raises UserError as restore() does."""
    try:
        race, states = pickle.loads((folder / CHECKPOINT).read_bytes())
    except OSError as e:
        raise UserError(
            f"--resume {folder} has no {CHECKPOINT} ({e.strerror}); name the --output folder of "
            "the autonomy that has ended."
        ) from None
    except Exception as e:  # a pickle of other systems may raise anything
        raise _unfit(folder, e) from None
    return race, states


def _unfit(folder: Path, error: Exception) -> UserError:
    return UserError(
        f"{folder / CHECKPOINT} does not fit this scenario ({words(error)}); start without "
        "--resume."
    )
