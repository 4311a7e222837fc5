"""The command line: its subcommands, each of which is in the room that does it."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from cyclopts import App

from airrace.analysis import command as analysis
from airrace.betaflight import command as betaflight
from airrace.commands import doctor, new, race
from airrace.common import command_line
from airrace.common.command_line import run_app
from airrace.common.version import VERSION
from airrace.evaluation import command as evaluation
from airrace.hitl import command as hitl
from airrace.league import command as league
from airrace.mavlink import command as mavlink
from airrace.track import command as track
from airrace.visualization import command as visualization

_HELP = """\
Autonomous drone racing: a drone explores a track from its camera's pixels, maps it, plans
and races. Begin with `airrace race`; every subcommand has a --help of its own."""
_COMPLETION_EPILOG = """\
examples:
  airrace completion bash > ~/.local/share/bash-completion/completions/airrace
  airrace completion zsh > ~/.zsh/completions/_airrace      a folder of fpath
  airrace completion fish > ~/.config/fish/completions/airrace.fish"""
_ROOMS = (
    race, visualization, analysis, track, evaluation, league, hitl, mavlink, betaflight, doctor, new
)  # fmt: skip


def make_app() -> App:
    """Returns the command line's App."""
    rooms = [room.add_to for room in _ROOMS]
    return command_line.make_app("airrace", VERSION, _HELP, *rooms, _add_completion)


def _add_completion(app: App) -> None:
    app.command(_completion(app), name="completion", help_epilogue=_COMPLETION_EPILOG)


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
    words = [str(word) for word in (sys.argv[1:] if argv is None else argv)]
    return run_app(make_app(), _for_clients(words))


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
