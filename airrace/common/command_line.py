"""A command line made of functions, and one sentence for every bad value.

Cyclopts makes options and help of a function's parameters, their types and docstrings.
"""

import os
import shlex
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter, Token
from cyclopts.exceptions import UnusedCliTokensError

from airrace.common.errors import UserError, exit_code

_NUMBA_FILE = ".numba_config.yaml"
_EPILOG = """\
Exit codes: 0 done, 1 interrupted or the race did not finish, 2 bad input."""


def _whole(type_: type, tokens: Sequence[Token]) -> int:
    """Returns a whole number, where Cyclopts would also take 2.5, for 2."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value} is no whole number.") from None


Whole = Annotated[int, Parameter(converter=_whole, metavar="N")]


def make_app(name: str, version: str, help: str, *subcommands: Callable[[App], None]) -> App:
    """Returns an App.

    Args:
        name, version, help: of the program.
        subcommands: each adds one or several; they are listed in this order.
    """
    app = App(
        name=name,
        version=version,
        help=help,
        help_epilogue=_EPILOG,
        help_format="plaintext",
        suppress_keyboard_interrupt=False,
        default_parameter=Parameter(
            name_transform=str,  # --scenario_file, as the scenario's fields are spelt
            negative_iterable=(),
            show_default=False,
            allow_repeating=True,  # the last one counts
        ),
    )
    for add_to in subcommands:
        add_to(app)
    for i, command in enumerate(app.resolved_commands()):  # in that order, not by name
        app[command].sort_key = i
    return app


def typed_command() -> str:
    """Returns the command `airrace` as it works for whoever started this process.

    In a clone, that is a Python with -m airrace; where airrace is no command on PATH, its path.
    """
    words, program = sys.orig_argv, sys.argv[0]
    options = len(words) - len(sys.argv) + 1
    if words[options - 2 : options] == ["-m", "airrace"]:
        return shlex.join([_beside(words[0]), "-m", "airrace"])
    if os.path.basename(program) == "airrace" and shutil.which("airrace") != program:
        return shlex.quote(_beside(program))
    return "airrace"


def _beside(program: str) -> str:
    """Returns the path of a program, from the working folder if it is below that."""
    path = os.path.relpath(program) if os.path.isabs(program) else program
    return program if path.startswith(os.pardir) else path


def run_app(app: App, words: Sequence[str | Path]) -> int:
    """Calls a subcommand, says what is wrong if anything is, and returns the exit code."""
    return exit_code(lambda: _call(app, [str(word) for word in words]))


def _check_working_folder() -> None:
    """Raises UserError if Numba would obey a file there, which may name code that it is to run."""
    if os.path.lexists(_NUMBA_FILE):
        raise UserError(
            f"The file {_NUMBA_FILE} in this folder would change how airrace computes; remove it, "
            "or call airrace in another folder."
        )


def _call(app: App, words: list[str]) -> int:
    _check_working_folder()
    try:
        code = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as e:
        command = " ".join([typed_command(), *(e.command_chain or ())])
        raise UserError(f"{_sentence(e)} See {command} --help.") from None
    return code or 0


def _sentence(error: CycloptsError) -> str:
    """Returns what Cyclopts says of a bad value, on one line."""
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"'{error.unused_tokens[0]}' is too much: this command takes no such argument."
    return " ".join(str(error).split())
