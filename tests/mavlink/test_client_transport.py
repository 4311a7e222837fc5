"""How time goes on with a client: paced, waiting, and in steps, over real UDP."""

import contextlib
import dataclasses as dc
import gc
import itertools
import json
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path

import numpy as np
import psutil
import pytest
from pydrake.systems.framework import Diagram
from pymavlink.dialects.v20 import common as mavlink

from airrace.diagrams.race import run_race
from airrace.mavlink import client_transport
from airrace.mavlink.bridge import MavlinkBridge
from airrace.mavlink.client_link import Addresses, ClientLink
from airrace.mavlink.client_transport import RESET_BY_CLIENT, ClientTransport
from airrace.mavlink.dialects import DIALECTS
from airrace.mavlink.grand_prix import fly_attempts
from airrace.systems.sensing.contact_sensor import as_contacts
from tests.worlds import killed_client
from tests.worlds.looks import Looks
from tests.worlds.mavlink_client import (
    Earpiece,
    Session,
    UdpClient,
    arm,
    command,
    grand_prix,
    rates,
    velocity,
)


class Client(threading.Thread):
    """A client in a thread of its own, which answers every HIGHRES_IMU."""

    def __init__(self, udp, answer):
        super().__init__(daemon=True)
        self.udp, self.answer, self.count, self.over = udp, answer, 0, threading.Event()

    def run(self):
        self.udp.hear(200.0)
        self.udp.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        while not self.over.is_set():
            for message in self.udp.hear(0.1):
                if message.get_type() == "HIGHRES_IMU":
                    self.udp.say(*self.answer(self.count, message))
                    self.count += 1


def fly(folder, answer, **fields):
    """Flies a race for a client; returns its states, race.json, and how many messages it heard."""
    looks = Looks()
    with UdpClient() as udp:
        port, pictures = udp.ports
        link = ClientLink(Addresses(port=port, picture_port=pictures), lambda line: None)
        client, scenario = Client(udp, answer), grand_prix(**fields)
        client.start()
        data = run_race(
            scenario, folder, transport=ClientTransport(scenario, link), sinks=[looks.take]
        )
        client.over.set()
        client.join(5.0)
        link.close()
    return np.array([look.state for look in looks]), data, client.count


def pilot(i, imu):
    """A command that follows from what was heard: it damps what the gyroscope says."""
    if i == 30:
        return [arm()]
    wave = 0.2 * np.sin(0.1 * i)
    damped = -0.1 * np.array([imu.xgyro, imu.ygyro, imu.zgyro])
    return [rates(0.32, *damped + [wave, 0.05, 0.0], mask=144)]


@pytest.mark.slow
def test_in_steps_a_flight_is_the_same_twice_to_the_bit(tmp_path, monkeypatch):
    """In the official dialect, with its start, which comes sooner here."""
    hurried = dc.replace(DIALECTS["official"], loading=0.0, countdown=0.1)
    monkeypatch.setitem(DIALECTS, "official", hurried)
    flights = []
    for name in "ab":
        (tmp_path / name).mkdir()
        flights.append(fly(tmp_path / name, pilot, dialect="official", step=True, time_limit=2.0))
        assert json.loads((tmp_path / name / "race.json").read_text()) == flights[-1][1]
    (states, data, count), (other, again, _) = flights
    assert count > 120 and data["wall"]["link"]["unanswered"] == 0
    np.testing.assert_array_equal(states, other)
    assert np.ptp(states[:, 6]) > 1.0  # it has flown
    assert data.pop("wall") and again.pop("wall") and data == again


@pytest.mark.slow
def test_a_client_that_does_not_answer_is_not_waited_for_for_ever(monkeypatch):
    """It is once, and again only after its next command."""
    monkeypatch.setattr(client_transport, "_ANSWER", 0.05)
    link = Earpiece()
    session = Session(grand_prix(step=True), link)
    waited = []
    link.wait = lambda seconds: waited.append(seconds)
    transport = session.transport
    transport.advance(session.simulator, 1.0)
    assert session.context.get_time() == 1.0
    # The 62nd is due 1 ms later.
    assert transport.wall(session.simulator)["link"]["unanswered"] == 61
    first = len(waited)
    assert first > 0
    transport.advance(session.simulator, 2.0)
    assert len(waited) == first
    # It speaks once more, and is silent again.
    link.say(rates(0.1))
    transport.advance(session.simulator, 3.0)
    assert len(waited) > first


def test_a_client_may_leave_after_its_finish(monkeypatch):
    monkeypatch.setattr(client_transport, "_ANSWER", 0.0)
    monkeypatch.setattr(MavlinkBridge, "finished", lambda self, context: context.get_time() > 0.5)
    session = Session(grand_prix(step=True))
    session.transport.advance(session.simulator, 1.0)
    assert session.transport.wall(session.simulator)["link"]["unanswered"] == 30


def test_a_client_that_sends_two_commands_a_step_is_obeyed():
    link = Earpiece()
    link.answer = lambda m: [rates(0.1), rates(0.2)] if m.get_type() == "HIGHRES_IMU" else []
    session = Session(grand_prix(step=True), link)
    session.transport.advance(session.simulator, 1.0)
    assert session.context.get_time() == 1.0
    assert session.transport.wall(session.simulator)["link"]["unanswered"] == 0
    assert session.bridge_context.get_discrete_state(0).value()[3] == pytest.approx(0.2)


def test_a_command_that_is_none_does_not_answer_a_step(monkeypatch):
    """Such as one of those that ground stations ask for rates with."""
    monkeypatch.setattr(client_transport, "_ANSWER", 0.0)
    asks = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 105, 1e4, *5 * [0.0])
    link = Earpiece(lambda m: [asks] if m.get_type() == "HIGHRES_IMU" else [])
    session = Session(grand_prix(step=True), link)
    session.transport.advance(session.simulator, 0.5)
    assert session.transport.wall(session.simulator)["link"]["unanswered"] == 30


def test_steps_are_those_messages_that_were_sent():
    """Where load keeps messages of the IMU back, nobody waits for an answer to them."""
    link = Earpiece(lambda m: [rates(0.1)] if m.get_type() == "HIGHRES_IMU" else [])
    text = "{mavlink: {step: true, quirks: {imu_drop: 0.9}}}"
    session = Session(grand_prix(text), link)
    session.transport.advance(session.simulator, 2.0)
    assert session.transport.wall(session.simulator)["link"]["unanswered"] == 0
    assert 10 < len(link.of("HIGHRES_IMU")) < 115


def test_as_fast_as_it_can_it_waits_for_the_clients_first_word():
    link = Earpiece()
    link.client, link.heard = None, False
    session = Session(grand_prix(), link)
    for _ in range(3):
        session.transport.advance(session.simulator, 0.1)
    assert session.context.get_time() == 0.0
    assert [m.get_type() for m in link.sent] == 3 * ["HEARTBEAT"]


def test_a_race_has_a_limit_of_time_from_arming():
    session = Session(grand_prix(time_limit=0.5))
    assert session.transport.advance(session.simulator, 1.0) is None
    session.link.say(arm())
    assert session.transport.advance(session.simulator, 1.3) is None
    assert session.transport.advance(session.simulator, 1.6) == "ran out of time"


@pytest.mark.repeats
def test_a_client_that_is_killed_in_flight_is_landed_for_and_a_line_says_so(tmp_path):
    """A process of its own, which is killed two metres above its pad, over UDP."""
    notes, looks = [], Looks()
    with UdpClient() as free:
        ports = free.ports
    script = Path(killed_client.__file__)
    client = subprocess.Popen([sys.executable, script, str(ports[0]), "2.0"])
    link = ClientLink(Addresses(port=ports[0], picture_port=ports[1]), notes.append)
    try:
        scenario = grand_prix(step=True, time_limit=12.0)
        data = run_race(
            scenario, tmp_path, transport=ClientTransport(scenario, link), sinks=[looks.take]
        )
    finally:
        client.kill()
        link.close()
    assert client.wait(10.0) == -signal.SIGKILL
    heights = [look.state[6] for look in looks]
    assert max(heights) > 1.2 and heights[-1] < 0.3
    # It is set down, at half a metre a second: never does it fall.
    assert np.diff(heights).min() > -0.1
    assert data["wall"]["link"]["watchdog"] == {"hovers": 1, "landings": 1, "stops": 1}
    lines = [note.partition("] ")[2] for note in notes if note.startswith("[")]
    assert lines == [
        "no set-points any more: the drone hovers",
        "still no set-points: the drone is set down",
        "no set-points: the motors have stopped",
    ]


def test_a_client_that_speaks_again_flies_again():
    session = Session(grand_prix())
    advance = session.transport.advance
    session.link.say(arm(), velocity(0.0, 0.0, -1.0))
    for tick in range(1, 16):  # it climbs on what it was told last, for half a second
        advance(session.simulator, 0.1 * tick)
    session.link.say(velocity(0.0, 0.0, -1.0))
    advance(session.simulator, 1.6)
    assert [note.partition("] ")[2] for note in session.link.notes] == [
        "no set-points any more: the drone hovers",
        "set-points come again",
    ]


def test_nothing_of_a_race_is_left():
    """Neither its diagram nor a system of it: who resets a thousand times has memory for it."""
    session = Session(grand_prix(vq=1))
    session.link.say(arm(), velocity(0.0, 0.0, -1.0))
    session.fly(0.1)
    diagrams = [session.diagram, *session.diagram.GetSystems()]
    inner = [one for one in diagrams[1:] if isinstance(one, Diagram)]
    diagrams += [each for one in inner for each in one.GetSystems()]
    left = [(type(each).__name__, weakref.ref(each)) for each in diagrams]
    assert len(left) > 20
    del session, diagrams, inner
    gc.collect()
    assert [name for name, reference in left if reference() is not None] == []


@pytest.mark.slow
def test_resets_again_and_again_leave_nothing_open(tmp_path):
    """Each begins on the pad, with all as at first, and no file or socket stays open."""
    link = Earpiece()
    resets, open_files, looks = 3, [], Looks()
    process = psutil.Process()

    def pages():
        link.say(arm(), rates(0.4), command(31000))
        if len(open_files) >= resets:
            link.messages.clear()
        gc.collect()
        open_files.append(process.num_fds())
        return contextlib.nullcontext()

    scenario = grand_prix(time_limit=0.1)
    attempts = fly_attempts(scenario, link, iter([tmp_path]), pages=pages, sinks=[looks.take])

    def arm_in_the_end(message):
        last = len(open_files) > resets and not any(
            m.get_type() == "COMMAND_LONG" for m in link.messages
        )
        return [arm()] if last and message.get_type() == "HEARTBEAT" else []

    link.answer = arm_in_the_end
    ((data, folder, count),) = attempts
    assert (folder, count) == (tmp_path, resets) and data["dnf_reason"] == "ran out of time"
    assert data["dnf_reason"] != RESET_BY_CLIENT
    states = [(look.time, *look.state) for look in looks]
    starts = [
        state for before, state in itertools.pairwise([(9e9,), *states]) if state[0] < before[0]
    ]
    np.testing.assert_array_equal(starts, [starts[0]] * len(starts))
    assert open_files[-1] <= open_files[2]


@pytest.mark.slow
def test_a_client_that_hits_the_floor_goes_on():
    """Contacts are told and counted; they do not end the race."""
    session = Session(grand_prix())
    session.link.say(arm())
    session.fly(2.5, velocity(0.0, 0.0, -1.0))
    assert session.link.of("COLLISION") == []
    session.fly(1.5, velocity(0.0, 0.0, 3.0))
    told = len(session.link.of("COLLISION"))
    counted = as_contacts(session.output("truth.contacts").copy())
    assert told > 0 and counted.environment >= told - 1 and counted.gates == 0.0
    assert not session.output("truth.referee_status").over
    state = session.fly(2.0, velocity(0.0, 0.0, -1.0))
    assert state.position[2] > 1.0
