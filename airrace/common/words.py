"""Words for people."""


def count(n: int, noun: str) -> str:
    """Returns a number and a noun whose plural ends in s: ``1 lap``, ``2 laps``."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
