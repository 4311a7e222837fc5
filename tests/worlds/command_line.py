"""The options of a command line, without what it does."""

from airrace.commands.app import make_app


def parse(command: str, words):
    """Returns the options that a subcommand would get.

    Raises:
        cyclopts.CycloptsError: on a bad value.
    """
    _, bound, _ = make_app().parse_args(
        [command, *map(str, words)], exit_on_error=False, print_error=False
    )
    bound.apply_defaults()
    return bound.arguments["options"]
