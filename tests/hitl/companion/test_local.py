"""An autonomy on this computer ends for certain, with all that it has started."""

import contextlib
import time

import pytest

from airrace.hitl.companion import local
from airrace.hitl.companion.local import LocalCompanion
from tests.hitl.companion.test_board import living, wait_for

STUBBORN = "trap '' TERM\nsleep 1000 &\necho worker $!\nwait\n"
OBEDIENT = "trap 'exit 1' TERM\nsleep 1000 &\necho worker $!\nwait\n"


@pytest.mark.parametrize("script, code", [(STUBBORN, -9), (OBEDIENT, 1)])
def test_stopping_ends_the_process_and_its_workers(script, code, tmp_path, monkeypatch):
    program = tmp_path / "python"
    program.write_text(f"#!/bin/sh\n{script}")
    program.chmod(0o755)
    monkeypatch.setattr(local, "module_command", lambda *words: [str(program)])
    log = []
    with contextlib.closing(LocalCompanion()) as companion:
        autonomy = companion.start([], {"a/b": b"1"}, log.append)
        wait_for(lambda: autonomy.poll() is None and log)
        worker = int(log[0].removeprefix("worker "))
        assert living(worker)
        assert (autonomy._folder / "a/b").stat().st_mode & 0o777 == 0o600  # a key is private
        clock = time.monotonic()
        autonomy.stop(timeout=0.5)
        assert time.monotonic() - clock < 4.0
        assert autonomy.poll() == code
        wait_for(lambda: not living(worker))
