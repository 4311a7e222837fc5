"""The ticks of lockstep, and the exchange over a link that loses messages."""

import contextlib
import itertools

import pytest
from pydrake.systems.analysis import Simulator

from airrace import lcmtypes
from airrace.common.errors import UserError
from airrace.diagrams.race import MakeRace
from airrace.diagrams.transport import POLL_PERIOD
from airrace.hitl.link import lockstep
from airrace.hitl.link.endpoint import HEARTBEAT, Channel, Endpoint, Received
from airrace.hitl.link.lockstep import Exchange, PeerLost, await_peer, lockstep_times
from airrace.hitl.link.packets import Stamp
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from airrace.scenario import Scenario


@pytest.mark.parametrize("preset", ["clean", "realistic"])
def test_nothing_happens_in_a_race_but_at_a_tick(preset):
    scenario = Scenario()
    scenario.camera.preset = preset
    scenario.camera.width, scenario.camera.height = 160, 90
    simulator = Simulator(MakeRace(scenario))
    steps = set()

    def see(context):
        steps.add(context.get_time())

    simulator.set_monitor(see)
    simulator.AdvanceTo(0.35)
    ticks = set(
        itertools.takewhile(lambda time: time <= 0.35, lockstep_times(scenario, POLL_PERIOD))
    )
    assert len(steps) > 350
    assert sorted(steps - {0.35} - ticks) == []


def test_ticks_are_in_order_and_hold_the_looks():
    times = list(itertools.islice(lockstep_times(Scenario(), POLL_PERIOD), 3000))
    assert times[0] == 0.0 and all(a < b for a, b in itertools.pairwise(times))
    assert {k * POLL_PERIOD for k in range(20)} <= set(times)


class Side:
    """One side whose only value is a count; what it showed is kept."""

    def __init__(self, role, link, decode=lambda message: message.value[0]):
        other = "autonomy" if role == "simulation" else "simulation"
        self.out, self.into = f"FROM_{role}", f"FROM_{other}"
        channel = Channel(self.into, lcmtypes.lcmt_rotors, other, decode)
        self.endpoint = Endpoint(role, [channel], link.bus(), clock=link.clock)
        self.value, self.shown = 0, []
        self.exchange = None

    def send(self, _):
        if self.value % 3:  # not at every tick
            return []
        message = lcmtypes.lcmt_rotors()
        message.count, message.value = 1, [float(self.value)]
        return [(self.out, self.endpoint.publish(self.out, message, 0.0))]

    def receive(self, _, endpoint):
        received = endpoint.newest(self.into)
        self.shown.append(received.value if received else None)


class Clock:
    def get_time(self):
        return 0.0


class Pause(Exception):
    """In the place of waiting."""


def greet(link, sides):
    """Lets both sides hear each other."""
    for side in 4 * sides:
        link.time += 0.05
        side.endpoint.send_heartbeat("ready", 0.0)
        side.endpoint.drain()


def begin(side, link, ticks):
    """Returns turns() of a side that does not wait but yields."""

    def pause(timeout):
        raise Pause

    side.exchange = Exchange(side.endpoint, side, side)
    side.endpoint.wait = pause
    return turns(side, link, ticks)


def turns(side, link, ticks):
    """Makes a side's exchanges; yields where it would wait."""
    for _ in range(ticks):
        side.exchange.send(Clock())
        while True:
            link.time += 0.002
            try:
                side.exchange.receive(Clock())
                break
            except Pause:
                yield
        side.value += 1
    while True:  # who is ready first answers the other until that one is, too
        side.exchange._asked = 0.0
        with contextlib.suppress(Pause):
            side.exchange.receive(Clock())
        yield


def test_what_nobody_will_ask_for_takes_no_memory():
    """Heartbeats of ticks far ahead, and messages with any numbers, of who has sniffed the race."""
    exchange = Exchange(Side("simulation", SimulatedLink(LinkConfig())).endpoint, None, None)
    for number in range(1, 2000):
        message = Received(number, Stamp(1, number, 0.0), 0.0)
        exchange._keep("FROM_autonomy", message)
        beat = lcmtypes.lcmt_heartbeat()
        beat.step = number
        exchange._keep(HEARTBEAT, Received(beat, Stamp(1, number, 0.0), 0.0))
    assert exchange.waiting == 64 + 2


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_an_exchange_gives_every_tick_its_own_messages_whatever_is_lost(loss, monkeypatch):
    link = SimulatedLink(LinkConfig(delay=0.001, jitter=0.001))
    sides = [Side("simulation", link), Side("autonomy", link)]
    greet(link, sides)
    link._config = LinkConfig(delay=0.001, jitter=0.001, loss=loss)
    monkeypatch.setattr(lockstep, "_RESEND", 0.0)

    ticks = 40
    runs = [begin(side, link, ticks) for side in sides]
    for _ in range(20_000):
        if min(side.value for side in sides) == ticks:
            break
        for run in runs:
            next(run)
    for side in sides:
        assert side.shown[:ticks] == [float(k - k % 3) for k in range(ticks)]


class Stalled(BaseException):
    """It has decoded for longer than anybody waits. (An endpoint survives any Exception.)"""


def test_a_decoder_that_is_slower_than_messages_are_sent_again():
    """200 ms for each message, which the other side sends again after 50 ms without an answer."""
    link = SimulatedLink(LinkConfig(delay=0.001))
    ticks, decoded = 10, []

    def decode(message):
        decoded.append(message.value[0])
        if len(decoded) > 5 * ticks:
            raise Stalled
        for _ in range(100):  # meanwhile, the other side waits and sends again
            link.time += 0.002
            next(runs[0])
        return message.value[0]

    sides = [Side("simulation", link), Side("autonomy", link, decode)]
    greet(link, sides)
    runs = [begin(side, link, ticks) for side in sides]
    for _ in range(20_000):
        if min(side.value for side in sides) == ticks:
            break
        for run in runs:
            link.time += 0.002
            next(run)
    for side in sides:
        assert side.shown[:ticks] == [float(k - k % 3) for k in range(ticks)]
    assert decoded == [0.0, 3.0, 6.0, 9.0]  # each once


def test_who_waits_for_long_sends_again_more_and_more_rarely():
    link = SimulatedLink(LinkConfig())
    side, other = Side("simulation", link), Side("autonomy", link)
    greet(link, [side, other])
    run, sent = begin(side, link, 1), []
    side.endpoint.republish = lambda channel, data: sent.append((channel, link.time))
    while link.time < 20.0:
        link.time += 0.005
        next(run)
    times = [time for channel, time in sent if channel == side.out]
    pauses = [b - a for a, b in itertools.pairwise(times)]
    assert pauses[:5] == pytest.approx([0.05, 0.1, 0.2, 0.4, 0.8], abs=0.012)
    assert pauses[6:] and pauses[6:] == pytest.approx([2.0] * len(pauses[6:]), abs=0.012)


def test_a_peer_that_never_comes():
    endpoint = Endpoint("simulation", [], SimulatedLink(LinkConfig()).bus())
    endpoint.wait = lambda timeout: None
    with pytest.raises(UserError, match="No autonomy answered within 0 s: check"):
        await_peer(endpoint, "waiting", timeout=0.05)


def test_what_is_sent_after_the_peer_was_awaited_is_heard():
    link = SimulatedLink(LinkConfig())
    simulation, autonomy = Side("simulation", link), Side("autonomy", link)

    def wait(seconds):
        link.time += seconds

    def be_the_autonomy():
        if not simulation.endpoint.peer_heartbeat.value.phase:
            autonomy.endpoint.drain()
            autonomy.endpoint.beat("waiting", 0.0)

    simulation.endpoint.wait = wait
    await_peer(simulation.endpoint, "testing", expected="waiting", timeout=5, poll=be_the_autonomy)
    simulation.value = 3  # is sent
    simulation.send(None)
    link.time += 0.01
    autonomy.endpoint.drain()
    statistics = autonomy.endpoint.statistics[autonomy.into]
    assert (statistics.received, dict(statistics.dropped)) == (1, {})


@pytest.mark.parametrize("patience", [1, 20])
def test_waits_are_as_long_as_one_is_patient(monkeypatch, patience):
    monkeypatch.setenv("AIRRACE_PATIENCE", str(patience))
    link = SimulatedLink(LinkConfig())
    endpoint = Endpoint("simulation", [], link.bus(), link.clock)

    def pass_time(seconds):
        link.time += seconds

    endpoint.wait = pass_time
    with pytest.raises(UserError, match=f"within {5 * patience} s: .* set AIRRACE_PATIENCE"):
        await_peer(endpoint, "waiting", timeout=5.0)
    assert link.time == pytest.approx(5.0 * patience, abs=0.1)

    # In a race, for the other side's next tick.
    side, other = Side("simulation", link), Side("autonomy", link)
    greet(link, [side, other])
    side.exchange = Exchange(side.endpoint, side, side)
    side.endpoint.wait = lambda timeout: pass_time(1.0)
    begun = link.time
    with pytest.raises(PeerLost):
        side.exchange.receive(Clock())
    assert link.time - begun == pytest.approx(120.0 * patience, abs=2.0)


@pytest.mark.parametrize("phase", ["testing", "compiling"])
@pytest.mark.parametrize("comes", [True, False])
def test_measuring_and_compiling_may_take_longer_than_the_patience(comes, phase):
    link = SimulatedLink(LinkConfig())
    simulation, autonomy = (
        Endpoint(role, [], link.bus(), link.clock) for role in ("simulation", "autonomy")
    )
    begun = link.time

    def pass_time(seconds):
        link.time += seconds

    def be_the_other():
        simulation.drain()
        if link.time < begun + 20.0:
            simulation.send_heartbeat(phase, 0.0)
        elif comes:
            simulation.send_heartbeat("ready", 0.0)

    autonomy.wait = pass_time
    gives_up = pytest.raises(UserError, match="within 5 s")
    with contextlib.nullcontext() if comes else gives_up:
        await_peer(autonomy, "waiting", expected="ready", timeout=5.0, poll=be_the_other)
    # Who was heard a second ago counts as there.
    assert link.time - begun == pytest.approx(20.0 if comes else 26.0, abs=0.5)
