"""Words for people."""


def count(n: int, noun: str) -> str:
    """Returns a number and a noun whose plural ends in s: ``1 lap``, ``2 laps``."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def printable(text: str) -> str:
    """Returns text from outside so that it can be shown: on one line, and nothing but what is seen.

    A terminal obeys escape sequences, and any reader what turns the direction of writing. So each
    character that is not seen is shown by its number: ``\\x1b``. Markup is another matter: text
    goes to rich as Text or without markup, and to a page through a template that escapes it.
    """
    return "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in text)
