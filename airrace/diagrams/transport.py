"""Where the autonomy of a race runs, as the loop of a race sees it."""

from typing import Protocol

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from airrace.scenario import INTERNAL, Scenario
from airrace.systems.types import RefereeStatus

POLL_PERIOD = 0.1  # s of simulated time between two polls of the race


class Transport(Protocol):
    """Joins the simulation of a race to its autonomy, and advances both.

    SITL has the autonomy in its own diagram (diagrams/in_process.py); in HITL it is at
    the other end of a link (remote_autonomy.py).

    Attributes:
        simulation: SITL or HITL, as race.json says it.
        flight_controllers: those of a scenario that it can fly.
    """

    simulation: str
    flight_controllers: tuple[str, ...] = (INTERNAL,)

    def AddToBuilder(
        self, builder: DiagramBuilder, scenario: Scenario, simulation: Diagram
    ) -> System:
        """Adds the autonomy, or what stands for it, and connects it by the names of its ports.

        Args:
            builder: of the race, with the simulation in it.
            scenario: the race.
            simulation: its diagram.

        Returns:
            a system with the autonomy's output ports.
        """
        ...

    def begin(self, simulator: Simulator) -> None:
        """Starts the race; the simulator is initialized."""
        return None

    def advance(self, simulator: Simulator, time: float) -> str | None:
        """Advances to a simulated time (s); returns why the race cannot go on, or None."""
        ...

    def end(self, simulator: Simulator) -> None:
        """Ends the autonomy, also after an error."""
        return None

    def wall(self, simulator: Simulator) -> dict:
        """Returns what belongs below `wall` in race.json."""
        return {}

    def judged(self, status: RefereeStatus, simulator: Simulator) -> RefereeStatus:
        """Returns the referee's status, with what only the link knows of it."""
        return status
