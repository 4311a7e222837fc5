"""How time goes on with a client: paced, waiting, and in steps, over real UDP."""

import contextlib
import gc
import itertools
import json
import threading

import numpy as np
import psutil
import pytest
from pymavlink.dialects.v20 import common as mavlink

from airrace.diagrams import client_transport
from airrace.diagrams.client_transport import RESET_BY_CLIENT, ClientTransport
from airrace.diagrams.grand_prix import fly_attempts
from airrace.diagrams.race import run_race
from airrace.mavlink.client_link import Addresses, ClientLink
from airrace.systems.sensing.contact_sensor import as_contacts
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
    states = []
    with UdpClient() as udp:
        port, pictures = udp.ports
        link = ClientLink(Addresses(port=port, picture_port=pictures), lambda line: None)
        client, scenario = Client(udp, answer), grand_prix(**fields)
        client.start()
        data = run_race(
            scenario,
            folder,
            transport=ClientTransport(scenario, link),
            show=lambda result, outputs: states.append(outputs.state.copy()),
        )
        client.over.set()
        client.join(5.0)
        link.close()
    return np.array(states), data, client.count


def pilot(i, imu):
    """A command that follows from what was heard: it damps what the gyroscope says."""
    if i == 30:
        return [arm()]
    wave = 0.2 * np.sin(0.1 * i)
    return [rates(0.32, wave - 0.1 * imu.xgyro, 0.05 - 0.1 * imu.ygyro, -0.1 * imu.zgyro)]


def test_in_steps_a_flight_is_the_same_twice_to_the_bit(tmp_path):
    flights = []
    for name in "ab":
        (tmp_path / name).mkdir()
        flights.append(fly(tmp_path / name, pilot, step=True, time_limit=2.0))
        assert json.loads((tmp_path / name / "race.json").read_text()) == flights[-1][1]
    (states, data, count), (other, again, _) = flights
    assert count > 120 and data["wall"]["link"]["unanswered"] == 0
    np.testing.assert_array_equal(states, other)
    assert np.ptp(states[:, 6]) > 1.0  # it has flown
    assert data.pop("wall") and again.pop("wall") and data == again


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


def test_a_client_that_sends_two_commands_a_step_is_obeyed():
    link = Earpiece()
    link.answer = lambda m: [rates(0.1), rates(0.2)] if m.get_type() == "HIGHRES_IMU" else []
    session = Session(grand_prix(step=True), link)
    session.transport.advance(session.simulator, 1.0)
    assert session.context.get_time() == 1.0
    assert session.transport.wall(session.simulator)["link"]["unanswered"] == 0
    assert session.bridge_context.get_discrete_state(0).value()[3] == pytest.approx(0.2)


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
    link.client = None
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


def test_resets_again_and_again_leave_nothing_open(tmp_path):
    """Each begins on the pad, with all as at first, and no file or socket stays open."""
    link = Earpiece()
    resets, open_files, states = 6, [], []
    process = psutil.Process()

    def pages():
        link.say(arm(), rates(0.4), command(31000))
        if len(open_files) >= resets:
            link.messages.clear()
        gc.collect()
        open_files.append(process.num_fds())
        return contextlib.nullcontext()

    def show(result, outputs):
        states.append((outputs.time, *outputs.state))

    scenario = grand_prix(time_limit=0.1)
    attempts = fly_attempts(scenario, link, iter([tmp_path]), pages=pages, show=show)

    def arm_in_the_end(message):
        last = len(open_files) > resets and not any(
            m.get_type() == "COMMAND_LONG" for m in link.messages
        )
        return [arm()] if last and message.get_type() == "HEARTBEAT" else []

    link.answer = arm_in_the_end
    ((data, folder, count),) = attempts
    assert (folder, count) == (tmp_path, resets) and data["dnf_reason"] == "ran out of time"
    assert data["dnf_reason"] != RESET_BY_CLIENT
    starts = [
        state for before, state in itertools.pairwise([(9e9,), *states]) if state[0] < before[0]
    ]
    np.testing.assert_array_equal(starts, [starts[0]] * len(starts))
    assert open_files[-1] <= open_files[2]


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
