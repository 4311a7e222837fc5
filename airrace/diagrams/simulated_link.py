"""HITL without hardware: both sides in one process, in simulated time, on a simulated link."""

from pathlib import Path
from typing import TYPE_CHECKING

from airrace.diagrams.autonomy_process import AutonomyProcess
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import SIMULATION, Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.remote_autonomy import RealTimeRemote

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator

    from airrace.scenario import Scenario

_TICK = 0.001  # s


class SimulatedRemote(RealTimeRemote):
    """Races over a link that is as bad as declared; the same race every time.

    It is the code of a race in real time but for the waiting: whatever either
    side computes takes no time. See airrace/hitl/transport.py.
    """

    def __init__(self, scenario: "Scenario", link: LinkConfig, output_dir: Path):
        """Constructs both sides.

        Args:
            scenario: the race; its ``link_delay`` is used.
            link: between them.
            output_dir: of the autonomy.
        """
        self._link = SimulatedLink(link)
        clock = self._link.clock
        self._autonomy = AutonomyProcess(scenario, self._link.bus(), output_dir, clock=clock)
        self._autonomy.build(lossless=False)
        channels = self._autonomy.channels
        super().__init__(channels, Endpoint(SIMULATION, channels, self._link.bus(), clock))

    def begin(self, simulator: "Simulator") -> None:
        context = simulator.get_mutable_context()
        while not self._autonomy.is_ready():
            self._link.time += _TICK
            self._send_heartbeat(0.0)
            self._send_initial_values(context)
            self._endpoint.drain()
            self._autonomy.poll_link(phases.WAITING)
        self._autonomy.start()
        self._start = self._link.time

    def _wait_for(self, tick, sim_time):
        self._link.time = self._start + tick
        self._let_autonomy_step(tick)
        self._send_heartbeat(sim_time)
        self._endpoint.drain()

    def _let_autonomy_step(self, now):
        self._autonomy.poll_link(phases.RACING)
        self._autonomy.step()

    def end(self, simulator: "Simulator") -> None:
        pass
