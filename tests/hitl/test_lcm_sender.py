"""A sender and a receiver alone, through their Contexts."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough

from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link.endpoint import Received
from airrace.hitl.link.packets import Stamp
from airrace.hitl.received_ports import LcmReceiver
from tests.hitl.link.messages import ROWS, message_of, values

BY_PORT = {row.ports[0]: row for row in ROWS}


class Sent:
    """In the place of an endpoint: keeps what is published."""

    def __init__(self):
        self.messages = []

    def publish(self, channel, message, sim_time):
        self.messages.append((channel, message, sim_time))
        return b"bytes"


class Bench:
    def __init__(self, port, lossless, **changes):
        self.row = dc.replace(BY_PORT[port], **changes)
        self.sent = Sent()
        builder = DiagramBuilder()
        for each in self.row.ports:
            initial = self.row.initial[each]
            is_vector = isinstance(initial, np.ndarray)
            system = builder.AddSystem(PassThrough(initial.size if is_vector else Value[object]()))
            builder.ExportInput(system.get_input_port(), each)
            builder.ExportOutput(system.get_output_port(), each)
        self.source = builder.Build()
        self.sender = LcmSender(self.source, [self.row], self.row.sender, self.sent, lossless)
        self.context = self.source.CreateDefaultContext()
        self.given = values()
        for each in self.row.ports:
            self.fix(each, self.given[each])

    def fix(self, port, value):
        port = self.source.GetInputPort(port)
        is_vector = isinstance(value, np.ndarray)
        port.FixValue(self.context, value if is_vector else Value[object](value))

    def at(self, time, value=None):
        """Sends at a time, with another value of the first port; returns how many went."""
        if value is not None:
            self.fix(self.row.ports[0], value)
        self.context.SetTime(time)
        return len(self.sender.send(self.context))


class Newest:
    """In the place of an endpoint: the newest of a channel is what it was given."""

    def __init__(self, value, time):
        self._received = Received(value, Stamp(1, 1, time), 0.0)

    def newest(self, channel, sim_time):
        return self._received


def receiver_of(row):
    return LcmReceiver([row], "autonomy" if row.sender == "simulation" else "simulation")


@pytest.mark.parametrize("port", list(BY_PORT))
def test_what_is_sent_is_what_is_received(port):
    bench = Bench(port, lossless=True)
    assert bench.at(0.25) == 1
    channel, message, time = bench.sent.messages[0]
    assert (channel, time) == (bench.row.name, 0.25)
    receiver = receiver_of(bench.row)
    if port.startswith("truth."):
        assert receiver.num_output_ports() == 0
        return
    context = receiver.CreateDefaultContext()
    receiver.receive(context, Newest(bench.row.decode(message), time))
    for each in bench.row.ports:
        shown, given = receiver.GetOutputPort(each).Eval(context), bench.given[each]
        if isinstance(given, np.ndarray):
            np.testing.assert_array_equal(shown, given)
        else:
            assert type(shown) is type(given)
    assert receiver.GetOutputPort(f"{bench.row.ports[0]}_time").Eval(context) == [0.25]


def test_in_lockstep_every_change_and_nothing_else():
    bench = Bench("rotor_speed_command", lossless=True)
    assert [bench.at(0.0), bench.at(0.001), bench.at(10.0)] == [1, 0, 0]
    assert [bench.at(10.001, np.ones(4)), bench.at(10.002, np.full(4, 2.0))] == [1, 1]


def test_in_real_time_at_most_at_the_rate_and_again_after_a_while():
    bench = Bench("rotor_speed_command", lossless=False, rate=100.0, repeat=0.5)
    counts = [bench.at(0.002 * k, np.full(4, float(k))) for k in range(50)]
    assert sum(counts) == 10
    quiet = [bench.at(0.1 + 0.01 * k) for k in range(1, 151)]
    assert 2 <= sum(quiet) <= 4
    bench.sender.forget()
    assert bench.at(1.7) == 1


def test_infinite_losses_do_not_change():
    bench = Bench("rotor_losses", lossless=True)
    bench.fix("rotor_losses", np.full(4, np.inf))
    assert [bench.at(0.0), bench.at(0.1), bench.at(0.2, np.array([np.inf, 0.2, 1, 1]))] == [1, 0, 1]


def test_a_picture_is_drawn_only_when_there_is_a_new_one():
    bench = Bench("camera_image_time", lossless=True)
    assert bench.at(0.0) == 1
    drawn = []
    encode = bench.row.encode
    object.__setattr__(bench.row, "encode", lambda **all: (drawn.append(1), encode(**all))[1])
    assert [bench.at(0.01), bench.at(0.02, np.array([0.5]))] == [0, 1] and len(drawn) == 1


def test_before_the_first_message_a_receiver_shows_the_initial_values():
    row = BY_PORT["rotor_speed_command"]
    receiver = receiver_of(row)
    context = receiver.CreateDefaultContext()
    assert receiver.GetOutputPort("rotor_speed_command").Eval(context).tolist() == [0.0] * 4
    assert message_of(row) is not None
