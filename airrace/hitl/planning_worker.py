"""Plans laps in another process, so that nothing else of the autonomy waits for a solver.

The process is told the scenario, and then of each problem what is new; what it answers is a lap
plan. All are the messages of the link, each after its length.
"""

import contextlib
import os
import select
import struct
import subprocess
import sys
from typing import IO, TYPE_CHECKING

from airrace.common.immutable import Immutable
from airrace.common.processes import child_environment
from airrace.common.resources import load_yaml
from airrace.hitl.link.plan_messages import LAP_PLAN, PLAN_REQUEST
from airrace.scenario import Scenario, scenario_yaml
from airrace.systems.planning.lap_plan import NO_PLAN

if TYPE_CHECKING:
    from airrace.systems.planning.lap_plan import LapPlan
    from airrace.systems.planning.lap_planner import LapPlanner
    from airrace.systems.planning.laps import LapProblem, PlanRequest

_NICE = 15  # control comes first
_LENGTH = struct.Struct("=I")
_KEPT = 4  # plans that the next search may start from


class PlanningWorker:
    """Solves one LapProblem after the other, in another process that has started already."""

    def __init__(self, scenario: Scenario) -> None:
        """Args: scenario: of the race; its planner solves them."""
        process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_environment(),
        )
        assert process.stdin is not None and process.stdout is not None  # they are pipes
        self._process, self._requests, self._answers = process, process.stdin, process.stdout
        with contextlib.suppress(OSError):
            _write(self._requests, scenario_yaml(scenario).encode())

    def submit(self, problem: "LapProblem") -> "PlanningJob":
        """Starts to solve a LapProblem; the job before, if any, is done or given up."""
        return PlanningJob(self._requests, self._answers, problem)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()


class PlanningJob(Immutable):
    """A problem that is being solved elsewhere."""

    def __init__(self, requests: IO[bytes], answers: IO[bytes], problem: "LapProblem"):
        self._answers, self._plan, self._is_done = answers, None, False
        try:
            _write(requests, PLAN_REQUEST.encode(problem.request).encode())
        except OSError:
            self._is_done = True  # without a worker there is no plan

    def __reduce__(self) -> tuple:
        return (type(None), ())  # in a checkpoint, where no worker goes on with it

    def done(self) -> bool:
        """Whether there is a result."""
        if not self._is_done and select.select([self._answers], [], [], 0.0)[0]:
            self._is_done = True
            with contextlib.suppress(EOFError):  # the worker has died
                plan = LAP_PLAN.decode(LAP_PLAN.message_type.decode(_read(self._answers)))
                self._plan = None if plan is NO_PLAN else plan
        return self._is_done

    def result(self) -> "LapPlan | None":
        """Returns the LapPlan, or None if there is none."""
        return self._plan


def _write(pipe: IO[bytes], data: bytes) -> None:
    pipe.write(_LENGTH.pack(len(data)) + data)
    pipe.flush()


def _read(pipe: IO[bytes]) -> bytes:
    """Returns the next message; raises EOFError if there is none, or not all of it."""
    head = pipe.read(_LENGTH.size)
    data = pipe.read(_LENGTH.unpack(head)[0]) if len(head) == _LENGTH.size else b""
    if not data:
        raise EOFError
    return data


class _Solver:
    """Solves problems by the planner of a scenario.

    A plan says less than what its search found, from which the next one may start: so plans are
    kept here as they were found.
    """

    def __init__(self, planner: "LapPlanner"):
        self._planner, self._found = planner, {}  # the latter by what _name() says

    def solve(self, request: "PlanRequest") -> "LapPlan | None":
        if request.old is not NO_PLAN:
            old = self._found.get(_name(request.old), request.old)
            request = request._replace(old=old)
        plan = self._planner.solve(self._planner.problem_of(request))
        if plan is not None:
            newest = list(self._found.items())[1 - _KEPT :]
            self._found = dict([*newest, (_name(plan), plan)])
        return plan


def _name(plan):
    return plan.lap, plan.circuit.duration  # it may have been put off


def main() -> None:
    """Solves what comes on standard input, until it ends."""
    os.nice(_NICE)  # before the imports: they take seconds of a processor
    from airrace.diagrams.autonomy import make_systems

    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what solvers print
    with contextlib.suppress(KeyboardInterrupt, EOFError):
        text = _read(sys.stdin.buffer).decode()
        scenario = load_yaml(Scenario, data=text, child_name="Defaults")
        solver = _Solver(make_systems(scenario, ["lap_planner"])["lap_planner"])
        while True:
            message = PLAN_REQUEST.message_type.decode(_read(sys.stdin.buffer))
            plan = solver.solve(PLAN_REQUEST.decode(message)) or NO_PLAN
            _write(answers, LAP_PLAN.encode(plan).encode())


if __name__ == "__main__":
    main()
