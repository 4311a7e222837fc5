"""Which of the test processes runs which test."""

import functools
from pathlib import Path

from xdist.scheduler import LoadScopeScheduling

_TESTS = Path(__file__).parent


class InOrder(LoadScopeScheduling):
    """Hands out tests in the order of tests/conftest.py: a process that is free takes the next.

    Only those stay in one process that share something: a browser, what a fixture or a function
    makes once for a module, or machine code that takes ten seconds to compile.
    """

    def __init__(self, config, log):
        config.option.loadscopereorder = False
        super().__init__(config, log)

    def _split_scope(self, nodeid):
        path = nodeid.partition("::")[0]
        if "in_browser" in path:
            return "browser"
        if "envs/batch" in path:
            return "batch"
        return path if _shares(path) else nodeid


@functools.cache
def _shares(path: str) -> bool:
    """Whether something of a file, or of its folder, is made once: by a fixture, or a function."""
    file = _TESTS.parent / path
    texts = (
        each.read_text(encoding="utf-8")
        for each in (file, file.with_name("conftest.py"))
        if each.exists()
    )
    return any('scope="module"' in text or "@functools.cache" in text for text in texts)
