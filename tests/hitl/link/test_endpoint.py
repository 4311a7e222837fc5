"""Two ends of a link in one process: what counts, what is dropped, and who is let in."""

import errno
import types

import numpy as np
import pytest

from airrace.hitl.link import packets
from airrace.hitl.link.endpoint import Endpoint
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink
from tests.hitl.link.messages import ROWS, message_of, values

CHANNELS = ROWS
COMMAND = next(row for row in ROWS if row.ports == ("rotor_speed_command",))
CAMERA = next(row for row in ROWS if "camera_view" in row.ports)
MAP = next(row for row in ROWS if row.ports == ("gate_map",))


@pytest.fixture
def link():
    """Both ends, which have heard each other, on a link that keeps all that was sent."""
    air = SimulatedLink(LinkConfig())
    sent = []
    send = air.send
    air.send = lambda channel, data: (sent.append((channel, data)), send(channel, data))
    ends = types.SimpleNamespace(
        air=air, sent=sent, simulation=end("simulation", air), autonomy=end("autonomy", air)
    )
    greet(ends)
    return ends


def end(role, air):
    return Endpoint(role, CHANNELS, air.bus(), clock=air.clock)


def greet(ends, count=4):
    for _ in range(count):
        for one in (ends.simulation, ends.autonomy):
            ends.air.time += 0.05
            one.send_heartbeat("waiting", 0.0)
            for other in (ends.simulation, ends.autonomy):
                other.drain()


def send(ends, row, time=0.0, given=None):
    data = ends.autonomy.publish(row.name, message_of(row, given), time)
    ends.simulation.drain()
    return data


def dropped(ends, row=COMMAND):
    return dict(ends.simulation.statistics[row.name].dropped)


def test_they_find_each_other_and_the_newest_message_counts(link):
    assert link.simulation.peer == link.autonomy.session
    assert link.autonomy.peer == link.simulation.session
    given = values()
    for k in range(3):
        given["rotor_speed_command"] = np.full(4, 10.0 + k)
        send(link, COMMAND, 0.1 * k, given)
    received = link.simulation.newest(COMMAND.name)
    assert received.value["rotor_speed_command"].tolist() == [12.0] * 4
    assert received.stamp == packets.Stamp(link.autonomy.session, 3, 0.2)
    assert link.autonomy.newest(COMMAND.name) is None  # one's own is not received
    assert dropped(link) == {}


def test_a_command_that_comes_early_waits_for_its_time(link):
    for time in (0.10, 0.20, 0.30):
        send(link, COMMAND, time)
    assert link.simulation.newest(COMMAND.name, 0.05) is None
    assert link.simulation.newest(COMMAND.name, 0.25).stamp.time == 0.20
    assert link.simulation.newest(COMMAND.name, 0.30).stamp.time == 0.30
    send(link, COMMAND, 1e9)
    assert dropped(link) == {packets.MALFORMED: 1}


def test_repeated_and_overtaken_messages_are_dropped_and_counted(link):
    first, second = send(link, MAP, 0.1), send(link, MAP, 0.2)
    for data in (first, second, first):
        link.air.send(MAP.name, data)
    link.simulation.drain()
    assert dropped(link, MAP) == {packets.REPLAYED: 3}
    assert link.simulation.newest(MAP.name).stamp.time == 0.2


def test_old_times_are_stale_and_skipped_numbers_are_missing(link):
    send(link, MAP, 10.0)
    send(link, COMMAND, 5.0)
    assert dropped(link) == {packets.STALE: 1}
    link.autonomy._sequences[MAP.name] += 7
    send(link, MAP, 10.1)
    assert link.simulation.statistics[MAP.name].missing == 7
    link.autonomy._sequences[MAP.name] += 10**7
    send(link, MAP, 10.2)
    assert dropped(link, MAP) == {packets.MALFORMED: 1}


def test_what_cannot_be_sent_is_lost(link, monkeypatch):
    send(link, MAP, 0.1)
    with monkeypatch.context() as pulled:

        def refuse(channel, data):
            raise OSError(errno.ENETUNREACH, "Network is unreachable")

        pulled.setattr(link.air, "send", refuse)
        send(link, MAP, 0.2)
    send(link, MAP, 0.3)
    statistics = link.simulation.statistics[MAP.name]
    assert (statistics.received, statistics.lost) == (2, 1)


def test_nan_oversized_torn_and_foreign(link):
    nan = {"rotor_speed_command": np.array([1.0, np.nan, 1.0, 1.0])}
    send(link, COMMAND, 0.0, nan)
    data = send(link, COMMAND)
    for bad in (data[:-1], b"", bytes(packets.MAX_SIZE + 1)):
        link.air.send(COMMAND.name, bad)
    stranger = Endpoint("autonomy", [], link.air.bus(), clock=link.air.clock)
    stranger.publish(COMMAND.name, message_of(COMMAND), 0.0)
    link.simulation.drain()
    assert dropped(link) == {
        packets.NOT_FINITE: 1,
        packets.MALFORMED: 2,
        packets.OVERSIZED: 1,
        packets.FOREIGN: 1,
    }
    assert link.simulation.statistics[COMMAND.name].received == 1


def test_another_number_of_rotors_is_malformed(link):
    send(link, COMMAND, 0.0, {"rotor_speed_command": np.ones(8)})
    assert dropped(link) == {packets.MALFORMED: 1}


def test_a_recording_of_an_earlier_run_is_foreign(link):
    send(link, COMMAND)
    recording = list(link.sent)
    link.simulation.close()
    link.autonomy.close()
    later = types.SimpleNamespace(air=link.air, simulation=end("simulation", link.air))
    for _ in range(5):
        later.air.time += 1.0
        later.simulation.send_heartbeat("waiting", 0.0)
        for channel, data in recording:
            link.air.send(channel, data)
        later.simulation.drain()
    assert later.simulation.peer == 0 and later.simulation.newest(COMMAND.name) is None
    # Whoever is alive gets in all the same.
    later.autonomy = end("autonomy", link.air)
    greet(later)
    assert later.simulation.peer == later.autonomy.session


def test_who_starts_again_is_let_in_and_who_is_gone_is_not(link):
    old = link.autonomy
    send(link, COMMAND, 1.0)
    old.close()
    link.air.time += 1.0
    link.autonomy = end("autonomy", link.air)
    greet(link)
    assert link.simulation.peer == link.autonomy.session != old.session
    send(link, COMMAND, 1.5)
    assert link.simulation.newest(COMMAND.name).stamp.sequence == 1  # counted anew
    data = old.publish(COMMAND.name, message_of(COMMAND), 2.0)
    link.simulation.drain()
    assert data and dropped(link)[packets.FOREIGN] == 1


def test_nobody_else_gets_in_while_the_other_side_is_alive(link):
    third = end("autonomy", link.air)
    for _ in range(20):
        link.air.time += 0.05
        for one in (link.simulation, link.autonomy, third):
            one.send_heartbeat("waiting", 0.0)
        for one in (link.simulation, link.autonomy, third):
            one.drain()
    assert link.simulation.peer == link.autonomy.session


def test_a_flood_of_stale_messages_changes_nothing(link):
    sound = send(link, COMMAND, 0.5)
    for _ in range(20_000):
        link.air.send(COMMAND.name, sound)
    link.simulation.drain()
    statistics = link.simulation.statistics[COMMAND.name]
    assert (statistics.received, dict(statistics.dropped)) == (1, {packets.REPLAYED: 20_000})


def test_of_pictures_that_wait_the_newest_is_decoded(link):
    count = [0]
    decode = CAMERA.decode

    def counted(message):
        count[0] += 1
        return decode(message)

    link.autonomy.close()
    link.autonomy._subscribe(types.SimpleNamespace(**{**vars(CAMERA), "decode": counted}))
    data = [link.simulation.publish(CAMERA.name, message_of(CAMERA), 0.1 * k) for k in range(5)]
    for bad in (data[1], data[4][:-1], data[4]):
        link.air.send(CAMERA.name, bad)
    link.autonomy.drain()
    statistics = link.autonomy.statistics[CAMERA.name]
    assert count == [1] and link.autonomy.newest(CAMERA.name).stamp.sequence == 5
    assert (statistics.received, statistics.missing) == (1, 0)
    assert dict(statistics.dropped) == {
        packets.OVERTAKEN: 4,
        packets.REPLAYED: 2,
        packets.MALFORMED: 1,
    }


class Stalled(BaseException):
    """It would go on for ever. (An endpoint survives any Exception.)"""


@pytest.mark.parametrize("keeps_all", [False, True])
def test_messages_without_an_end_do_not_take_every_turn(link, keeps_all):
    """As when each takes 200 ms to decode, while several more come."""
    if keeps_all:
        link.simulation.keep_all(lambda channel, received: None, lambda channel, sequence: False)
    count, decode = [0], COMMAND.decode

    def slow(message):
        count[0] += 1
        if count[0] > 10:
            raise Stalled
        link.air.time += 0.2
        for _ in range(3):
            link.autonomy.publish(COMMAND.name, message_of(COMMAND), 0.0)
        return decode(message)

    channel = types.SimpleNamespace(**{**vars(COMMAND), "decode": slow})
    link.simulation.close()
    link.simulation._subscribe(channel)
    link.autonomy.publish(COMMAND.name, message_of(COMMAND), 0.0)
    for drained in range(1, 4):
        link.simulation.drain()
        assert count[0] == drained
