"""The autonomy's end of a race in lockstep: tick by tick, until the simulation ends the race."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from pydrake.systems.analysis import Simulator

from airrace.diagrams.transport import POLL_PERIOD
from airrace.hitl.link import phases
from airrace.hitl.link.lockstep import Exchange, PeerLost, lockstep_times

if TYPE_CHECKING:
    from airrace.hitl.lcm_bridge import Side
    from airrace.hitl.link.endpoint import Endpoint
    from airrace.scenario import Scenario

LEFT, STOPPED, LOST = 0, 1, 3  # exit codes
NOTHING_HEARD = "it heard nothing of the simulation for {:.0f} s"


def race_in_lockstep(
    scenario: "Scenario",
    side: "Side",
    endpoint: "Endpoint",
    log: Callable[[str], object] = print,
    stop: Callable[[], bool] = lambda: False,
) -> int:
    """Races; returns the exit code: LEFT after the race, STOPPED or LOST.

    Args: side: from MakeLockstepSide(). endpoint: of the autonomy, which has met the simulation's.
    stop: asked now and then; whether to end.
    """
    simulator = Simulator(side.diagram)
    context, code = simulator.get_mutable_context(), LEFT
    exchange = Exchange(endpoint, side.receiver, side.sender)
    try:
        exchange.receive(context, stop, poll=lambda: endpoint.beat(phases.READY, 0.0))
        for now in lockstep_times(scenario, POLL_PERIOD):
            if now == 0.0:
                simulator.Initialize()
                exchange.send(context)
                continue
            simulator.AdvanceTo(now)
            exchange.send(context)
            if exchange.receive(context, stop):
                break
    except PeerLost as e:
        log(f"airrace: the simulation fell silent for {e.args[0]:.0f} s")
        endpoint.say_last(phases.RACING, context.get_time(), NOTHING_HEARD.format(e.args[0]))
        code = LOST
    writer = side.diagram.GetSubsystemByName("gate_map_writer")
    writer.ForcedPublish(writer.GetMyContextFromRoot(context))
    return STOPPED if code == LEFT and stop() else code
