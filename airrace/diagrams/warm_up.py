"""Compiles what a race calls before it starts: real time waits for nobody."""

from pydrake.systems.analysis import Simulator

from airrace.diagrams.runner import MakeRace
from airrace.diagrams.scenario import Scenario

_TIME = 1.5  # s: it has seen, measured and mapped, and takes off by then


def warm_up(scenario: Scenario) -> None:
    """Flies the first moment of a race in this process, and forgets it.

    The machine code of the inner loops is compiled, or read from the disk, when it is
    first called (see airrace/compiled.py).
    """
    Simulator(MakeRace(scenario)).AdvanceTo(_TIME)
