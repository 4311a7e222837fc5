"""The exceptions that mean "the user can fix this", and what programs make of them."""

import os
import sys
from collections.abc import Callable

from airrace.common.words import printable


class UserError(Exception):
    """Bad input from outside: a file, an option, a missing system library.

    Its message is one sentence that names the culprit and the remedy. The
    command-line programs print it without a traceback and exit with code 2.
    """

    def __init__(self, sentence: str):
        """Args: sentence: which may repeat what a file says; it is made printable()."""
        super().__init__(printable(sentence))


class OwnCodeError(Exception):
    """Code of the user's own has raised an exception, which is the cause of this one.

    Its message is what a terminal shows: where in the user's own files, then one sentence.
    """


def words(error: BaseException) -> str:
    """Returns what an error says, on one line and without a full stop."""
    text = " ".join(printable(getattr(error, "strerror", None) or str(error)).split())
    return (text or type(error).__name__).rstrip(".")[:300]


def exit_code(program: Callable[[], int]) -> int:
    """Calls a command-line program; returns its exit code.

    Bad input is one sentence and 2, Ctrl-C is 1, and so are a reader that has left, and a mistake
    in code of the user's own.
    """
    try:
        code = program()
        if sys.stdout is not None:  # it is None if it was closed before Python started
            sys.stdout.flush()
        return code
    except UserError as e:
        print(f"airrace: {e}", file=sys.stderr)
        return 2
    except OwnCodeError as e:
        print(e, file=sys.stderr)
        return 1
    except BrokenPipeError:  # whoever read has left, such as head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is held back
        return 1
    except KeyboardInterrupt:
        print("airrace: interrupted", file=sys.stderr)
        return 1
