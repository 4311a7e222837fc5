"""Calls in Python processes of their own, one after the other."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

from airrace.common.processes import ONE_THREAD


def one_thread_each() -> None:
    """From now on, the numerical libraries of processes that are started use one thread.

    Then a race is flown on one core, and several do not wait for one another's threads.
    """
    for name, one in ONE_THREAD.items():
        os.environ.setdefault(name, one)


def in_fresh_processes(function, calls):
    """Yields what a function returns, called again and again, each time in a new process.

    What one call leaves in memory and in caches is then nothing to the next.

    Args:
        function: of a module, such that the process finds it.
        calls: the arguments of each call.
    """
    context = multiprocessing.get_context("spawn")
    for arguments in calls:
        with ProcessPoolExecutor(1, context) as pool:
            yield pool.submit(function, *arguments).result()
