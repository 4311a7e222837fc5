"""What the simulation says of an autonomy that is there no more."""

import types

import pytest

from airrace.common.errors import UserError
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.link.lockstep import PeerLost
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.hitl.remote_autonomy import LockstepRemote, RealTimeRemote
from airrace.systems.failsafe.command_watchdog import HOLD, LAND
from airrace.systems.types import RefereeStatus

SILENT = "the autonomy fell silent at 3.2 s"


def meet(code, says=""):
    """Returns an endpoint and a poll(): of an autonomy that last said something, and has ended."""
    link = SimulatedLink(LinkConfig())
    here, there = (Endpoint(role, [], link.bus(), link.clock) for role in (SIMULATION, AUTONOMY))
    for text in ("", "", says):
        for one, other in ((here, there), (there, here)):
            link.time += 0.05
            one.send_heartbeat(phases.WAITING, 0.0, text)
            other.drain()
    here.wait = lambda timeout: setattr(link, "time", link.time + timeout)
    return here, lambda: code


@pytest.mark.parametrize(
    "code, says, mode, refereed, reason",
    [
        (None, "", LAND, "hit the ground", f"{SILENT}, and the drone landed by itself"),
        (-11, "", LAND, "hit the ground", f"{SILENT} (its process was killed: SIGSEGV), and the "),
        (1, "", LAND, "hit the ground", f"{SILENT} (its process ended with exit code 1), and the "),
        (4, "why", LAND, "hit the ground", f"{SILENT} (why), and the drone landed by itself"),
        (-9, "", LAND, "hit gate 1", f"hit gate 1: {SILENT} (its process was killed: SIGKILL)"),
        (-11, "", HOLD, "hit gate 1", "hit gate 1 (its process was killed: SIGSEGV)"),
        (None, "", HOLD, "hit gate 1", "hit gate 1"),
        (None, "\x1b[2J", LAND, "hit the ground", rf"{SILENT} (\x1b[2J), and the"),
    ],
)
def test_why_a_race_in_real_time_ended(code, says, mode, refereed, reason):
    endpoint, poll = meet(code, says)
    remote = RealTimeRemote((), endpoint, poll)
    memory = types.SimpleNamespace(mode=mode, last=3.2, airborne=True)
    remote._watchdog_memory = lambda context: memory
    status = RefereeStatus((), False, refereed, 3.0, 1)
    simulator = types.SimpleNamespace(get_context=lambda: None)
    assert remote.judged(status, simulator).dnf_reason.startswith(reason)
    if code is not None and not says:
        memory.mode, memory.airborne = LAND, False
        assert remote._given_up(None).endswith(reason[reason.index(" (") :].partition(")")[0] + ")")


@pytest.mark.parametrize(
    "code, says, reason",
    [
        (-6, "", "the autonomy left the race (its process was killed: SIGABRT)"),
        (None, "it was told to stop", "the autonomy left the race (it was told to stop)"),
    ],
)
def test_why_a_race_in_lockstep_ended(code, says, reason):
    endpoint, poll = meet(code, says)
    remote = LockstepRemote((), endpoint, poll)
    remote._exchange = types.SimpleNamespace(
        send=lambda context: None, receive=lambda context, stop: stop()
    )
    assert remote._step(None) == reason


def test_a_silence_in_lockstep():
    def lose(context, stop):
        assert not stop()
        raise PeerLost(120.0)

    remote = LockstepRemote((), *meet(None))
    remote._exchange = types.SimpleNamespace(send=lambda context: None, receive=lose)
    assert remote._step(None) == "the autonomy fell silent for 120 s"


def test_one_that_dies_before_it_is_ready_is_not_waited_for():
    remote = LockstepRemote((), *meet(-11))
    with pytest.raises(UserError, match="process was killed: SIGSEGV before the race"):
        remote._meet()
