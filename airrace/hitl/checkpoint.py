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


def save(folder: Path, autonomy: "Diagram", root_context: "Context") -> None:
    """Writes the state of all systems of an autonomy.

    Args:
        folder: where CHECKPOINT goes.
        autonomy: the diagram of the systems.
        root_context: of the diagram that it is part of.
    """
    states = {}
    for system in autonomy.GetSystems():
        context = system.GetMyContextFromRoot(root_context)
        states[system.get_name()] = (
            [
                context.get_discrete_state(i).CopyToVector()
                for i in range(context.num_discrete_state_groups())
            ],
            [
                context.get_abstract_state(i).get_value()
                for i in range(context.num_abstract_states())
            ],
        )
    write_bytes(folder / CHECKPOINT, pickle.dumps(states))


def restore(folder: Path, autonomy: "Diagram", root_context: "Context") -> None:
    """Gives the systems the state that save() has written.

    Only of folders whose owner you trust: a pickle can run code.

    Args: see save().

    Raises:
        UserError: if there is none, or it is another autonomy's.
    """
    path = Path(folder) / CHECKPOINT
    try:
        states = pickle.loads(path.read_bytes())
        for system in autonomy.GetSystems():
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
