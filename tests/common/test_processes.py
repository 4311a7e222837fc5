import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from airrace.common.processes import bound_to, child_environment, real_time_priority


def test_a_child_elsewhere_imports_what_this_process_does(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "only_here.py").write_text("ANSWER = 42\n")
    monkeypatch.chdir(tmp_path / "mine")
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    monkeypatch.setenv("AIRRACE_TEST", "kept")
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import airrace, only_here, os; print(only_here.ANSWER, os.environ['AIRRACE_TEST'])",
        ],
        cwd=tmp_path,
        env=child_environment(),
        capture_output=True,
        text=True,
    )
    assert done.stdout == "42 kept\n", done.stderr


def policies():
    """Of Python's threads: libraries that draw have others, with policies of their own."""
    numbers = [thread.native_id for thread in threading.enumerate()]
    # Python keeps what it knows of threads of libraries when they have ended.
    live = [number for number in numbers if Path(f"/proc/self/task/{number}").exists()]
    return {os.sched_getscheduler(number) for number in live}


def test_all_threads_go_before_other_processes_for_a_while():
    before, event = policies(), threading.Event()
    thread = threading.Thread(target=event.wait)
    thread.start()
    try:
        with real_time_priority() as granted:
            assert policies() == ({os.SCHED_FIFO} if granted else before)
        assert policies() == before
    finally:
        event.set()
        thread.join()


def test_who_may_not_go_first_runs_as_before(monkeypatch):
    def refuse(*args):
        raise PermissionError

    before = policies()
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time_priority() as granted:
        assert not granted and policies() == before


def test_what_fails_meanwhile_ends_the_priority():
    before = policies()
    with pytest.raises(ZeroDivisionError), real_time_priority():
        raise ZeroDivisionError
    assert policies() == before


CHILD = """
import os, sys, time
from airrace.common.processes import bound_to
with bound_to(int(sys.argv[1])):
    print(os.getpid(), flush=True)
    time.sleep(60.0)
"""
PARENT = f"""
import os, subprocess, sys
subprocess.run([sys.executable, "-c", {CHILD!r}, str(os.getpid())])
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_child_ends_with_its_parent_however_that_ends(number):
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        assert int(parent.stdout.readline()) != parent.pid
        parent.send_signal(number)
        assert parent.wait() == -number
        start = time.monotonic()
        assert parent.stdout.read() == b""  # it ends when the child does, which holds it open
    assert time.monotonic() - start < 30.0


def test_a_child_whose_parent_has_ended_before_ends_too():
    done = subprocess.run([sys.executable, "-c", CHILD, "1"], timeout=30, capture_output=True)
    assert done.returncode == 1


def test_a_process_that_is_bound_no_more_goes_on():
    with bound_to(1):
        pass
    time.sleep(0.4)
