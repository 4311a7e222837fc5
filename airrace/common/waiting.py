"""What people see while they wait for some seconds."""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def waiting(what: str) -> Iterator[None]:
    """Says on standard error what is being done while its block lasts.

    On a terminal, something turns meanwhile; elsewhere, as in a pipe, it is a line.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        console.print(f"{what}...", markup=False, highlight=False, soft_wrap=True)
    with console.status(f"{what}..."):
        yield
