"""Plans laps in a process of its own, so that control goes on meanwhile."""

import contextlib
import os
import pickle
import select
import subprocess
import sys
from typing import TYPE_CHECKING

from airrace.common.immutable import Immutable
from airrace.common.processes import child_environment

if TYPE_CHECKING:
    from airrace.systems.planning.lap_plan import LapPlan
    from airrace.systems.planning.laps import LapProblem

_NICE = 15  # control comes first


class PlanningWorker:
    """Solves one LapProblem after the other, in another process that has started already."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "airrace.hitl.planning_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_environment(),
        )

    def submit(self, problem: "LapProblem") -> "PlanningJob":
        """Starts to solve a LapProblem; the job before, if any, is done or given up."""
        return PlanningJob(self._process, problem)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()


class PlanningJob(Immutable):
    """A problem that is being solved elsewhere."""

    def __init__(self, process: subprocess.Popen, problem: "LapProblem"):
        self._answers, self._plan, self._is_done = process.stdout, None, False
        try:
            _write(process.stdin, problem)
        except OSError:
            self._is_done = True  # without a worker there is no plan

    def __reduce__(self) -> tuple:
        return (type(None), ())  # in a checkpoint, where no worker goes on with it

    def done(self) -> bool:
        """Whether there is a result."""
        if not self._is_done and select.select([self._answers], [], [], 0.0)[0]:
            self._is_done = True
            with contextlib.suppress(EOFError, pickle.UnpicklingError):  # the worker has died
                self._plan = pickle.load(self._answers)
        return self._is_done

    def result(self) -> "LapPlan | None":
        """Returns the LapPlan, or None if there is none."""
        return self._plan


def _write(pipe, value):
    pipe.write(pickle.dumps(value))
    pipe.flush()


def main() -> None:
    """Solves what comes on standard input, until it ends."""
    os.nice(_NICE)  # before the imports: they take seconds of a processor
    from airrace.systems.planning.lap_planning import plan_lap

    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what solvers print
    with contextlib.suppress(KeyboardInterrupt, EOFError):
        while True:
            _write(answers, plan_lap(pickle.load(sys.stdin.buffer)))


if __name__ == "__main__":
    main()
