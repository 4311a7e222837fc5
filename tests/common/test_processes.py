import os
import subprocess
import sys
import threading

import pytest

from airrace.common.processes import child_environment, real_time_priority


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
    return {os.sched_getscheduler(thread.native_id) for thread in threading.enumerate()}


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
