"""The command line: its subcommands, and one sentence for every bad value.

Cyclopts makes options and help of a function's parameters, their types and docstrings.
"""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from cyclopts import App, CycloptsError, Parameter
from cyclopts.exceptions import UnusedCliTokensError

from airrace import __version__
from airrace.commands import (
    doctor,
    evaluate,
    grand_prix,
    hitl,
    league,
    new,
    race,
    replay,
    report,
    tables,
    track,
)
from airrace.common.errors import UserError, exit_code

_HELP = """\
Autonomous drone racing: a drone explores a track from its camera's pixels, maps it, plans
and races. Begin with `airrace race`; every subcommand has a --help of its own."""
_EPILOG = """\
Exit codes: 0 done, 1 interrupted or the race did not finish, 2 bad input."""


def make_app() -> App:
    """Returns the command line's App."""
    app = App(
        name="airrace",
        version=__version__,
        help=_HELP,
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
    others = (report, tables, track, evaluate, league, hitl, grand_prix, doctor, new)
    for module in (race, replay, *others):
        module.add_to(app)
    app.command(_completion(app), name="completion", help_epilogue=_COMPLETION_EPILOG)
    for i, name in enumerate(app.resolved_commands()):  # listed as they were added, not by name
        app[name].sort_key = i
    return app


_COMPLETION_EPILOG = """\
examples:
  airrace completion bash > ~/.local/share/bash-completion/completions/airrace
  airrace completion zsh > ~/.zsh/completions/_airrace      a folder of fpath
  airrace completion fish > ~/.config/fish/completions/airrace.fish"""


def _completion(app: App) -> Callable[[Literal["bash", "zsh", "fish"]], int]:
    def completion(shell: Literal["bash", "zsh", "fish"], /) -> int:
        """Print what makes a shell complete airrace's options.

        Args:
            shell: that you type in
        """
        print(app.generate_completion(shell=shell))
        return 0

    return completion


def main(argv: Sequence[str | Path] | None = None) -> int:
    """The command-line program; returns its exit code."""
    # A scenario may name a module beside which airrace was called.
    if not {"", os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    return exit_code(lambda: _call(sys.argv[1:] if argv is None else argv))


def _call(argv: Sequence[str | Path]) -> int:
    """Calls a subcommand; returns its exit code.

    Raises:
        UserError: on a bad value, or what the subcommand raises.
    """
    words = _for_clients([str(word) for word in argv])
    try:
        code = make_app()(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
    except CycloptsError as e:
        command = " ".join(["airrace", *(e.command_chain or ())])
        raise UserError(f"{_sentence(e)} See {command} --help.") from None
    return code or 0


def _for_clients(words: list[str]) -> list[str]:
    """Returns the words of a command line, with `race -s MAVLINK` written as `grand-prix`.

    So a client's race takes the options of its own command.
    """
    for i in range(1, len(words)):
        option, equals, value = words[i].partition("=")
        if option not in ("-s", "--simulation"):
            continue
        value, after = (value, i + 1) if equals else ("".join(words[i + 1 : i + 2]), i + 2)
        if words[0] == "race" and value == race.MAVLINK:
            return ["grand-prix", *words[1:i], *words[after:]]
    return words


def _sentence(error: CycloptsError) -> str:
    """Returns what Cyclopts says of a bad value, on one line."""
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"'{error.unused_tokens[0]}' is too much: this command takes no such argument."
    return " ".join(str(error).split())
