"""Starts the tiny autonomy of fake_checkout.py, and follows what it prints.

It takes a second or two; a machine that is busy may need more than ten.
"""

import time

from airrace.common.patience import patient
from airrace.hitl.companion import READY


class Log(list):
    """The lines of an autonomy that is polled."""

    def wait(self, autonomy, line, timeout=60.0):
        """Polls until a line has come."""
        self.until(autonomy, lambda: line in self, timeout)

    def end(self, autonomy, timeout=60.0):
        """Polls until the autonomy has ended; returns its exit code."""
        self.until(autonomy, lambda: autonomy.poll() is not None, timeout)
        return autonomy.poll()

    def until(self, autonomy, condition, timeout):
        deadline = time.monotonic() + patient(timeout)
        while not condition():
            autonomy.poll()
            assert time.monotonic() < deadline, self
            time.sleep(0.01)


def start(companion, *words, files=None):
    """Starts the tiny autonomy; returns it when it is ready, and its log."""
    log = Log()
    autonomy = companion.start(words, files or {}, log.append)
    log.wait(autonomy, READY)
    return autonomy, log
