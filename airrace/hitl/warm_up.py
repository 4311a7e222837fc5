"""Compiles what both sides of a link call before a race: in real time there is no time for it."""

import dataclasses as dc

import numpy as np
from pydrake.systems.analysis import Simulator

from airrace.common.held_folders import temporary_folder
from airrace.diagrams.race import MakeRace
from airrace.hitl.playback import LINK, NavigatorPlayback, PilotPlayback
from airrace.hitl.simulated_link import SimulatedRemote
from airrace.scenario import LINK_DELAY, Scenario
from airrace.systems.control.rotor_commands import set_speeds

_TIME = 0.6  # s: it has seen, measured and mapped, and takes off by then
_BRIEF = 0.3  # s: it has seen by then


def warm_up(scenario: Scenario) -> None:
    """Flies the first moment of a race over a link, all in this process, and forgets it.

    The machine code of the inner loops is compiled, or read from the disk, when it is
    first called (see airrace/common/jit.py).
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    with temporary_folder() as folder:
        transport = SimulatedRemote(scenario, LINK, folder)
        simulator = Simulator(MakeRace(scenario, transport=transport))
        simulator.Initialize()
        transport.begin(simulator)
        transport.advance(simulator, _TIME)
    # So early no rotor is at a limit: then this is called for what the controller wants otherwise.
    one = np.zeros(1)
    set_speeds(one, one, one, one, one, one, 1.0)


def warm_up_pilot(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the pilot alone for a moment, and forgets it.

    What simulates and draws is not called, nor what the navigator runs: a companion does not need
    the one, and compiles the other in the navigator's process. A board takes minutes to compile.

    Args: briefly: to go on with a race: the code is on the disk, and a drone is hovering.
    """
    play_pilot(scenario, _BRIEF if briefly else _TIME)


def warm_up_navigator(scenario: Scenario, briefly: bool = False) -> None:
    """Flies the navigator alone for a moment, and forgets it; see warm_up_pilot()."""
    play_navigator(scenario, _BRIEF if briefly else _TIME)


def play_pilot(scenario: Scenario, duration: float) -> np.ndarray:
    """Flies the pilot alone for a while (s) by made-up messages, and forgets it.

    Returns how long it took for each millisecond (s), (n,).
    """
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    return PilotPlayback(scenario).play(duration)


def play_navigator(scenario: Scenario, duration: float) -> np.ndarray:
    """Flies the navigator alone by made-up messages, and forgets it; see play_pilot()."""
    scenario = dc.replace(scenario, link_delay=LINK_DELAY)
    with temporary_folder() as folder:
        return NavigatorPlayback(scenario, folder).play(duration)
