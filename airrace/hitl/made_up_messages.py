"""Messages of a race that is not simulated: a drone stands before a gate."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from airrace.diagrams.standing_drone import Standing
from airrace.hitl.handover import PortValues
from airrace.hitl.link.endpoint import SIMULATION
from airrace.hitl.playback import Message

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.scenario import Scenario


def standing(
    scenario: "Scenario", channels: "Sequence[PortChannel]", duration: float
) -> list[Message]:
    """Returns what the simulation of a drone that stands before a gate would send.

    Args:
        scenario: whose drone, camera and rates to use.
        channels: PortChannels of the race.
        duration: (s).
    """
    values = Standing(scenario, duration)
    messages = [
        Message(
            time,
            channel.name,
            channel.encode(
                lossless=False, **{port: values.of(port, time) for port in channel.ports}
            ),
        )
        for channel in channels
        if channel.sender == SIMULATION and not channel.ports[0].startswith("truth.")
        for time in np.arange(0.0, duration, 1.0 / channel.rate).tolist()
    ]
    return sorted(messages, key=lambda each: each.time)


def made_up_values(scenario: "Scenario", told: dict[str, Any], duration: float) -> list[PortValues]:
    """Returns what the other half of the autonomy of a drone that stands there would say.

    Args:
        scenario: see standing().
        told: name of each port to what it holds at first.
        duration: (s).
    """
    values, rate = Standing(scenario, duration), scenario.state_estimate.rate
    times = np.arange(0.0, duration, 1.0 / rate).tolist()
    return [
        PortValues(time, {port: values.told(port, first, time) for port, first in told.items()})
        for time in times
    ]
