import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from airrace.common import processes
from airrace.common.processes import bound_to, processors, real_time_priority


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


def test_processors_are_those_that_this_process_may_use(tmp_path, monkeypatch):
    """By its affinity, and by the quota of any cgroup that it is in."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {*range(64)})
    monkeypatch.setattr(processes, "_CGROUPS", tmp_path)
    monkeypatch.setattr(processes, "_OWN_CGROUP", tmp_path / "own")
    assert processors() == 64
    (tmp_path / "own").write_text("1:cpu:/elsewhere\n0::/job/step\n")
    (tmp_path / "job" / "step").mkdir(parents=True)
    (tmp_path / "job" / "step" / "cpu.max").write_text("max 100000\n")
    assert processors() == 64
    (tmp_path / "job" / "cpu.max").write_text("450000 100000\n")
    assert processors() == 4
    (tmp_path / "job" / "step" / "cpu.max").write_text("50000 100000\n")
    assert processors() == 1
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {3, 5})
    (tmp_path / "own").write_text("0::/\n")
    assert processors() == 2


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


@pytest.mark.parametrize(
    "code, words",
    [
        (0, "ended with exit code 0"),
        (3, "ended with exit code 3"),
        (-signal.SIGSEGV, "was killed: SIGSEGV"),
        (-63, "was killed: signal 63"),
    ],
)
def test_how_a_process_ended(code, words):
    assert processes.ending(code) == words
