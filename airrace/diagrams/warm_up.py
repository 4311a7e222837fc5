"""Compiles what a race calls before it starts: real time waits for nobody."""

import dataclasses as dc
import tempfile
from pathlib import Path

from pydrake.systems.analysis import Simulator

from airrace.diagrams.runner import MakeRace
from airrace.diagrams.scenario import LINK_DELAY, Scenario
from airrace.diagrams.simulated_link import SimulatedRemote
from airrace.link.simulated_bus import LinkConfig

_TIME = 0.6  # s: it has seen, measured and mapped, and takes off by then
_BRIEF = 0.3  # s: it has seen by then
LINK = LinkConfig(delay=0.01, jitter=0.0, loss=0.0, seed=0)  # long enough to compensate for


def warm_up(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the first moment of a race over a link, all in this process, and forgets it.

    The machine code of the inner loops is compiled, or read from the disk, when it is
    first called (see airrace/compiled.py).

    Args:
        scenario: of the race.
        briefly: for one who goes on with a race: the code is on the disk, and a drone is
            waiting in the air.
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    with tempfile.TemporaryDirectory() as folder:
        partner = SimulatedRemote(scenario, LINK, Path(folder))
        simulator = Simulator(MakeRace(scenario, partner=partner))
        simulator.Initialize()
        partner.begin(simulator)
        partner.advance(simulator, _BRIEF if briefly else _TIME)
