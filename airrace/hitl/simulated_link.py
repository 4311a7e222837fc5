"""HITL without hardware: both sides in one process, in simulated time, on a simulated link."""

from pathlib import Path
from typing import TYPE_CHECKING

from airrace.hitl.handover import queue_pair
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.navigator import Navigator
from airrace.hitl.pilot import Pilot, make_halves
from airrace.hitl.remote_autonomy import RealTimeRemote

if TYPE_CHECKING:
    from pydrake.systems.analysis import Simulator

    from airrace.scenario import Scenario

_TICK = 0.001  # s


class SimulatedRemote(RealTimeRemote):
    """Races over a link that is as bad as declared; the same race every time.

    It is the code of a race in real time but for the waiting: whatever either
    side computes takes no time. See airrace/diagrams/transport.py.
    """

    def __init__(self, scenario: "Scenario", link: LinkConfig, output_dir: Path):
        """Constructs both sides; the scenario's ``link_delay`` is used."""
        self._link = SimulatedLink(link)
        clock, halves = self._link.clock, make_halves(scenario)
        channels = halves.channels(scenario)
        self._of_pilot = Endpoint(AUTONOMY, channels, self._link.bus(), clock)
        here, there = queue_pair()
        self._pilot = Pilot(scenario, halves, self._of_pilot, here)
        self._navigator = Navigator(
            scenario,
            halves,
            self._link.bus(),
            there,
            output_dir=output_dir,
            session=self._of_pilot.session,
            clock=clock,
        )
        super().__init__(channels, Endpoint(SIMULATION, channels, self._link.bus(), clock))

    def begin(self, simulator: "Simulator") -> None:
        context = simulator.get_mutable_context()
        while not self._pilot.is_ready():
            self._link.time += _TICK
            self._endpoint.beat(phases.READY, 0.0)
            self._send_initial_values(context)
            self._endpoint.drain()
            self._poll_autonomy(phases.WAITING)
            self._pilot.prepare()
            self._navigator.step()
        self._pilot.start()
        self._start = self._link.time

    def _wait_for(self, tick, sim_time):
        self._link.time = self._start + tick
        self._let_autonomy_step(tick)
        self._endpoint.beat(phases.RACING, sim_time)
        self._endpoint.drain()

    def _let_autonomy_step(self, now):
        self._poll_autonomy(phases.RACING)
        self._pilot.step()
        self._navigator.step()

    def _poll_autonomy(self, phase):
        self._of_pilot.drain()
        self._of_pilot.beat(phase, self._pilot.time)

    def end(self, simulator: "Simulator") -> None:
        pass
