"""What pilot and navigator tell each other: in order, in one piece, and never waiting."""

import socket

import numpy as np
import pytest

from airrace.hitl.handover import PortValues, Ready, SocketHandover, queue_pair
from airrace.systems.planning.lap_plan import NO_PLAN
from tests.hitl.link.messages import lap_plan


def ends(kind):
    return queue_pair() if kind == "queue" else tuple(map(SocketHandover, socket.socketpair()))


@pytest.mark.parametrize("kind", ["queue", "socket"])
def test_what_is_sent_comes_in_order(kind):
    one, other = ends(kind)
    assert other.receive() == []
    plan = lap_plan()
    for message in (
        PortValues(0.5, {"state_estimate": np.arange(14.0)}),
        PortValues(0.6, {"lap_plan": plan}),
        Ready(),
        PortValues(0.7, {"lap_plan": NO_PLAN}),
    ):
        assert one.send(message)
    first, second, ready, third = other.receive()
    np.testing.assert_array_equal(first.by_port["state_estimate"], np.arange(14.0))
    assert first.time == 0.5 and ready == Ready()
    np.testing.assert_array_equal(
        second.by_port["lap_plan"].derivatives(3.0), plan.derivatives(3.0)
    )
    assert third.by_port["lap_plan"] is NO_PLAN
    assert other.send(PortValues(1.0, {})) and one.receive()[0].time == 1.0


def test_nobody_waits_for_one_that_does_not_listen():
    one, other = ends("socket")
    sent = 0
    while one.send(PortValues(float(sent), {"imu_history": np.zeros(1000)})):
        sent += 1
        assert sent < 100_000
    assert sent > 10 and not one.link.is_broken
    heard = [message.time for message in other.receive()]
    assert one.send(PortValues(-1.0, {}))  # and the rest of what did not fit as a whole
    heard += [message.time for message in other.receive()]
    assert heard == [*range(sent), -1.0]


def test_the_end_of_the_other_one_is_noticed():
    one, other = ends("socket")
    one.send(PortValues(1.0, {}))
    one.link.close()
    assert [message.time for message in other.receive()] == [1.0]  # what it said last still counts
    assert other.link.is_broken and other.receive() == []
    assert not other.send(PortValues(2.0, {}))
