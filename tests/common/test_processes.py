import os
import threading

import pytest

from airrace.common.processes import real_time_priority


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
