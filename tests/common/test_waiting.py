import io
import time

import pytest
from rich import console

from airrace.common.waiting import waiting


@pytest.mark.parametrize("is_terminal", [True, False])
def test_it_is_said_before_the_work_ends(monkeypatch, is_terminal):
    file = io.StringIO()
    made = console.Console(file=file, force_terminal=is_terminal)
    monkeypatch.setattr(console, "Console", lambda **options: made)
    with waiting("Reading"):
        deadline = time.monotonic() + 5.0
        while "Reading..." not in file.getvalue():
            assert time.monotonic() < deadline
            time.sleep(0.02)
