"""What an autonomy knows, on disk, so that another process can go on with it."""

import pickle
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
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


def save(folder: Path, states: dict) -> None:
    """Writes the states of all systems of an autonomy, from states_of(), as CHECKPOINT."""
    write_bytes(folder / CHECKPOINT, pickle.dumps(states))


def restore(folder: Path, part: "Diagram", root_context: "Context") -> None:
    """Gives the systems of a diagram the states that save() has written.

    Only of folders whose owner you trust: a pickle can run code.

    Args: folder: see save(). The others: see states_of().

    Raises UserError if there is none, or it is another autonomy's.
    """
    path = Path(folder) / CHECKPOINT
    try:
        states = pickle.loads(path.read_bytes())
        for system in part.GetSystems():
            discrete, abstract = states[system.get_name()]
            context = system.GetMyMutableContextFromRoot(root_context)
            for i, value in enumerate(discrete):
                context.SetDiscreteState(i, value)
            for i, value in enumerate(abstract):
                context.SetAbstractState(i, value)
    except OSError as e:
        raise UserError(
            f"--resume {folder} has no {CHECKPOINT} ({e.strerror}); name the --output folder of "
            "the autonomy that has ended."
        ) from None
    except Exception as e:  # a pickle of other systems may raise anything
        raise UserError(
            f"{path} does not fit this scenario ({type(e).__name__}: {e}); start without --resume."
        ) from None
