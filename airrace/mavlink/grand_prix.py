"""Races that a client flies over MAVLink, one after the other, without an end of the client."""

import gc
import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.analysis import Simulator
from pymavlink.dialects.v20 import common as mavlink

from airrace.diagrams.race import INTERRUPTED, MakeRace, run_race
from airrace.mavlink.client_link import Addresses, ClientLink
from airrace.mavlink.client_transport import ClientTransport
from airrace.mavlink.commands import ARM

if TYPE_CHECKING:
    from airrace.recording.foxglove_server import FoxgloveServer
    from airrace.recording.race_events import Sink
    from airrace.scenario import Scenario
    from airrace.visualization.live_page import LivePage

_WARM_UP = 0.2  # s of simulated time, in which everything runs once
# type_mask of set-points that set nothing but a velocity, rates, or an attitude.
_VELOCITY_ONLY, _RATES_ONLY, _ATTITUDE_ONLY = 0b110111000111, 128, 7

# What shows a race: opens for each attempt, and gives its page, or None.
Pages = Callable[[], AbstractContextManager["LivePage | None"]]


def fly_attempts(
    scenario: "Scenario",
    link: ClientLink,
    folders: Iterator[Path],
    *,
    pages: Pages,
    sinks: "Iterable[Sink]",
    foxglove: "FoxgloveServer | None" = None,
) -> Iterator[tuple[dict, Path, int]]:
    """Flies races for one client; a reset begins one anew, with everything as at first.

    A reset builds the simulation again, from the same scenario and seed: so nothing of an attempt
    is left in the next one. The results of an attempt that was reset are replaced.

    Args: folders: an existing folder for the results of each race. pages: what shows each attempt.
    sinks, foxglove: see run_race(), which may raise UserError.

    Yields:
        of each race that has ended by itself, or by Ctrl-C: race.json, its folder, and how often
        it was reset.
    """
    before = None
    for folder in folders:
        for resets in itertools.count():
            data, again = _attempt(scenario, link, folder, before, pages, sinks, foxglove)
            before = (before or 0.0) + data["simulated_s"]
            if not again:
                break
        yield data, folder, resets
        if data["dnf_reason"] == INTERRUPTED:
            return


def _attempt(scenario, link, folder, before, pages, sinks, foxglove):
    """Flies once; returns race.json, and whether the client wants to begin anew."""
    transport = ClientTransport(scenario, link, before)
    with pages() as page:
        data = run_race(
            scenario, folder, page=page, sinks=sinks, transport=transport, foxglove=foxglove
        )
    again = transport.reset_wanted and data["dnf_reason"] != INTERRUPTED
    # What was built holds on to itself, in Python and in Drake.
    del transport, page
    gc.collect()
    return data, again


def warm_up_grand_prix(scenario: "Scenario") -> None:
    """Flies for a moment without a client, and forgets it: so that all is compiled."""
    link = ClientLink(Addresses(port=9, picture_port=9), note=lambda line: None)
    try:
        transport = ClientTransport(scenario, link)
        simulator = Simulator(MakeRace(scenario, transport=transport))
        simulator.set_target_realtime_rate(0.0)
        simulator.Initialize()
        arm = mavlink.MAVLink_command_long_message(1, 1, ARM, 0, 1.0, *6 * [0.0])
        attitude = [1.0, 0.0, 0.0, 0.0]
        rates = mavlink.MAVLink_set_attitude_target_message(
            0, 1, 1, _RATES_ONLY, attitude, 0.0, 0.1, 0.0, 0.3
        )
        velocity = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, _VELOCITY_ONLY, *3 * [0.0], 0.0, 0.0, -0.5, *5 * [0.0]
        )
        level = mavlink.MAVLink_set_attitude_target_message(
            0, 1, 1, _ATTITUDE_ONLY, attitude, 0.0, 0.0, 0.0, 0.3
        )
        # A part of the time for each kind of set-point.
        parts = [arm, rates], [velocity], [level]
        for i, messages in enumerate(parts, 1):
            link.messages += messages
            simulator.AdvanceTo(_WARM_UP * i / len(parts))
    finally:
        link.close()
