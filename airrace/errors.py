"""The one exception that means "the user can fix this"."""


class UserError(Exception):
    """Bad input from outside: a file, an option, a missing system library.

    Its message is one sentence that names the culprit and the remedy. The
    command-line programs print it without a traceback and exit with code 2.
    """
