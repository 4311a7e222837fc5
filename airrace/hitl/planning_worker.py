"""Plans laps in another process, so that nothing else of the autonomy waits for a solver.

The process is told the scenario, and then of each problem what is new; what it answers is a lap
plan, or the sentence of a UserError. All but the first are messages of the link.
"""

import contextlib
import os
import socket
import sys
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
from airrace.common.immutable import Immutable
from airrace.common.resources import load_yaml
from airrace.hitl.link.message_socket import MessageSocket, start_module
from airrace.hitl.link.plan_messages import LAP_PLAN, PLAN_REQUEST
from airrace.scenario import Scenario, scenario_yaml
from airrace.systems.planning.lap_plan import NO_PLAN

if TYPE_CHECKING:
    from airrace.systems.planning.lap_plan import LapPlan
    from airrace.systems.planning.lap_planner import LapPlanner
    from airrace.systems.planning.laps import LapProblem, PlanRequest

_NICE = 15  # control comes first
_PLAN, _SENTENCE = b"p", b"s"  # with which an answer begins
_KEPT = 4  # plans that the next search may start from


class PlanningWorker:
    """Solves one LapProblem after the other, in another process that has started already."""

    def __init__(self, scenario: Scenario) -> None:
        """Args: scenario: of the race; its planner solves them."""
        self._process, end = start_module(__name__)
        self._link = MessageSocket(end)
        self._link.send(scenario_yaml(scenario).encode())

    def submit(self, problem: "LapProblem") -> "PlanningJob":
        """Starts to solve a LapProblem; the job before, if any, is done or given up."""
        return PlanningJob(self._link, problem)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.wait()
        self._link.close()


class PlanningJob(Immutable):
    """A problem that is being solved elsewhere."""

    def __init__(self, link: MessageSocket, problem: "LapProblem"):
        self._link, self._plan, self._is_done = link, None, False
        link.send(PLAN_REQUEST.encode(problem.request).encode())

    def __reduce__(self) -> tuple:
        return (type(None), ())  # in a checkpoint, where no worker goes on with it

    def done(self) -> bool:
        """Whether there is a result.

        Raises:
            UserError: that the planner has raised, such as on a lap plan of one's own that is none.
        """
        if not self._is_done and (answer := self._link.receive()) is not None:
            if answer[:1] == _SENTENCE:
                raise UserError(answer[1:].decode())
            plan = LAP_PLAN.decode(LAP_PLAN.message_type.decode(answer[1:]))
            self._plan, self._is_done = None if plan is NO_PLAN else plan, True
        return self._is_done or self._link.is_broken  # without a worker there is no plan

    def result(self) -> "LapPlan | None":
        """Returns the LapPlan, or None if there is none."""
        return self._plan


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


def main(fileno: int) -> None:
    """Solves what the process at the other end of a socket asks for, until it ends."""
    os.nice(_NICE)  # before the imports: they take seconds of a processor
    from airrace.diagrams.autonomy import make_systems

    link = MessageSocket(socket.socket(fileno=fileno))
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what solvers print
    with contextlib.suppress(KeyboardInterrupt):
        if (text := link.wait_for_message()) is None:
            return
        scenario = load_yaml(Scenario, data=text.decode(), child_name="Defaults")
        solver = _Solver(make_systems(scenario, ["lap_planner"])["lap_planner"])
        while request := link.wait_for_message():
            asked = PLAN_REQUEST.decode(PLAN_REQUEST.message_type.decode(request))
            try:
                plan = LAP_PLAN.encode(solver.solve(asked) or NO_PLAN).encode()
                link.send(_PLAN + plan)
            except UserError as e:
                link.send(_SENTENCE + str(e).encode())


if __name__ == "__main__":
    main(int(sys.argv[1]))
