"""HITL without hardware: both sides in one process, in simulated time, on a simulated link."""

from airrace.diagrams.autonomy_process import AutonomyProcess
from airrace.diagrams.channels import SIMULATION
from airrace.diagrams.remote import RealTimeRemote
from airrace.link.endpoint import Endpoint
from airrace.link.simulated_bus import LinkConfig, SimulatedBus

_TICK = 0.001  # s


class SimulatedRemote(RealTimeRemote):
    """Races over a link that is as bad as declared; the same race every time.

    It is the code of a race in real time but for the waiting: whatever either
    side computes takes no time. See airrace/diagrams/partner.py.
    """

    def __init__(self, scenario, link: LinkConfig, output_dir):
        """Constructs both sides.

        Args:
            scenario: the race; its ``link_delay`` is used.
            link: between them.
            output_dir: of the autonomy.
        """
        self._bus = SimulatedBus(link)
        self._autonomy = AutonomyProcess(
            scenario, self._bus, output_dir, clock=self._bus.clock, in_process=True)
        self._autonomy.build(lossless=False)
        rows = self._autonomy.rows
        endpoint = Endpoint(
            SIMULATION, [row.as_channel() for row in rows], self._bus, clock=self._bus.clock)
        super().__init__(rows, endpoint)

    def begin(self, simulator):
        context = simulator.get_mutable_context()
        while not self._autonomy.is_ready():
            self._bus.time += _TICK
            self._beat(self._bus.time, 0.0)
            self._show_start(context)
            self._endpoint.drain()
            self._autonomy.hear("waiting")
        self._autonomy.start()
        self._start = self._bus.time

    def _wait_for(self, tick, sim_time):
        self._bus.time = self._start + tick
        self._autonomy.hear("racing")
        self._autonomy.step()
        self._beat(self._bus.time, sim_time)
        self._endpoint.drain()

    def end(self, simulator):
        pass
