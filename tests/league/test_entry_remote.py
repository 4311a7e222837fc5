"""What an entry may send, and what is said of one that sends something else."""

import types

import pytest

from airrace import lcmtypes
from airrace.hitl.link.endpoint import AUTONOMY, HEARTBEAT, SIMULATION, Endpoint
from airrace.hitl.link.partners import Partner
from airrace.league import entry_remote
from airrace.league.entry_remote import EntryFailed, GuardedBus, last_words, meet_entry
from airrace.league.season import Limits
from airrace.scenario import Scenario
from tests.worlds.sockets import drain


class Process:
    """In the place of an EntryProcess: one that runs, or has ended."""

    def __init__(self, code=None, lines=()):
        self.code = code
        self.log = types.SimpleNamespace(lines=list(lines), wait=lambda: None)

    def poll(self):
        return self.code

    def excess(self):
        return None


@pytest.fixture
def link(ends):
    """A bus that is guarded, and the entry's end of it."""
    bus = GuardedBus(ends[0])
    bus.allowed = ("AIRRACE_ROTOR_SPEED_COMMAND",)
    entry = entry_remote.SocketBus(ends[1])
    return bus, entry


def rotors():
    message = lcmtypes.lcmt_rotors()
    message.count, message.value = 4, [1.0] * 4
    return message


def test_what_an_autonomy_sends(link):
    bus, entry = link
    endpoint = Endpoint(AUTONOMY, (), entry)
    endpoint.send_heartbeat("waiting", 0.0)
    endpoint.publish("AIRRACE_ROTOR_SPEED_COMMAND", rotors(), 0.0)
    entry.publish(HEARTBEAT, b"garbage")  # dropped, as on any link
    drain(bus)
    assert bus.violation is None and bus.received > 0


def test_to_speak_as_the_simulation(link):
    bus, entry = link
    seen = []
    bus.subscribe(HEARTBEAT, lambda *message: seen.append(message))
    Endpoint(SIMULATION, (), entry).send_heartbeat("ready", 0.0)
    drain(bus)
    assert bus.violation == "it spoke as the simulation" and seen == []


@pytest.mark.parametrize("channel", ["AIRRACE_REFEREE_STATUS", "AIRRACE_STATE_ESTIMATE", "X"])
def test_to_send_what_only_the_simulation_sends(link, channel):
    bus, entry = link
    Endpoint(AUTONOMY, (), entry).publish(channel, rotors(), 0.0)
    drain(bus)
    assert bus.violation == f"it sent on {channel}, which is not a channel of the autonomy"


def test_to_send_without_an_end(link, monkeypatch):
    monkeypatch.setattr(entry_remote, "_MOST_SENT", 1 << 20)
    bus, entry = link
    bus.begin_step()
    for _ in range(1200):
        entry.publish("AIRRACE_ROTOR_SPEED_COMMAND", bytes(1000))
        drain(bus)
    assert bus.violation == "it sent more than 1 MB in one step"


def meet(ends, process, ports=None, start_wall=0.5):
    """What meet_entry() says of an entry that asks for some ports, if it does."""
    if ports is not None:
        bus = entry_remote.SocketBus(ends[1])
        Endpoint(AUTONOMY, (), bus, me=Partner(ports=ports)).send_heartbeat("waiting", 0.0)
    limits = Limits(start_wall=start_wall)
    with pytest.raises(EntryFailed) as caught:
        meet_entry(Scenario(estimator="vio"), GuardedBus(ends[0]), process, limits)
    return str(caught.value)


def test_one_that_never_comes(ends):
    assert meet(ends, Process()) == "the entry was not ready to race within 0.5 s"


def test_one_that_has_ended(ends):
    words = meet(ends, Process(2, ["Traceback", "airrace: ValueError: no, at mine.py:3"]))
    assert words == "the entry was stopped by an error: ValueError: no, at mine.py:3"
    assert last_words(Process(-9)) == "the entry was stopped by an error: exit code -9"


def test_one_whose_end_is_closed(ends):
    ends[1].close()
    assert "was stopped by an error" in meet(ends, Process(0))
