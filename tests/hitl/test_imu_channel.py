"""Samples of the IMU over a link that loses messages, and of an IMU that fails."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.channels import make_channels
from airrace.hitl.lcm_bridge import ports_wanted
from airrace.hitl.lcm_sender import LcmSender
from airrace.hitl.link.packets import Stamp, pack, unpack
from airrace.scenario import TRUTH, VIO, Scenario
from airrace.systems.sensing.imu import Imu
from airrace.systems.sensing.imu_samples import IMU_DEPTH, IMU_SIZE, NO_SAMPLES
from airrace.vehicle.imu_errors import ImuErrors
from airrace.vehicle.sensor_failures import ImuFailure

STILL = np.array([1.0, *np.zeros(12)])
(CHANNEL,) = (row for row in make_channels(Scenario(), ("imu",)) if row.ports == ("imu",))


class Sent:
    """In the place of an endpoint: keeps the bytes of what is published."""

    def __init__(self):
        self.messages = []

    def publish(self, channel, message, sim_time):
        self.messages.append(pack(message, Stamp(1, len(self.messages) + 1, sim_time)))
        return self.messages[-1]


def sent_in(seconds, lossless, **kwargs):
    """Returns the messages of an IMU at rest, and all that it measured, (n, 7)."""
    builder = DiagramBuilder()
    imu = builder.AddSystem(Imu(rate=500.0, errors=ImuErrors(gyro_noise=0.01), **kwargs))
    builder.ExportInput(imu.GetInputPort("state"), "state")
    builder.ExportOutput(imu.get_output_port(), "imu")
    diagram = builder.Build()
    simulator, sent, measured = Simulator(diagram), Sent(), []
    context = simulator.get_mutable_context()
    diagram.GetInputPort("state").FixValue(context, STILL)
    sender = LcmSender(diagram, [CHANNEL], "simulation", sent, lossless)
    for k in range(1, round(seconds / 0.001) + 1):
        simulator.AdvanceTo(0.001 * k)
        sender.send(context)
        measured.append(diagram.get_output_port().Eval(context)[:7])
    measured = np.array(measured)
    return sent.messages, measured[np.diff(measured[:, 0], prepend=-1.0) > 0.0]


def received(messages):
    """Returns what a reader takes of messages: each row that is newer than the newest, (n, 7)."""
    rows, newest = [], 0.0
    for data in messages:
        vector = CHANNEL.decode(unpack(data, CHANNEL.message_type)[0])["imu"]
        assert vector.shape == (IMU_SIZE,) and not vector.flags.writeable
        for row in vector.reshape(IMU_DEPTH, -1)[::-1]:
            if row[0] > newest:
                newest = row[0]
                rows.append(row)
    return np.array(rows)


def test_in_real_time_a_hundred_messages_a_second_hold_every_sample():
    messages, measured = sent_in(1.0, lossless=False)
    assert 100 <= len(messages) <= 112
    rows = received(messages)
    assert len(rows) >= len(measured) - 5  # the others are not sent yet
    np.testing.assert_array_equal(rows, measured[: len(rows)])


@pytest.mark.parametrize("which", [0, 1])
def test_every_other_message_may_get_lost(which):
    messages, measured = sent_in(1.0, lossless=False)
    rows = received(messages[which::2])
    assert len(rows) >= len(measured) - 10
    np.testing.assert_array_equal(rows, measured[: len(rows)])


def test_what_two_messages_in_a_row_held_stays_a_gap():
    messages, measured = sent_in(0.5, lossless=False)
    rows = received(messages[:20] + messages[22:])
    missing = sorted(set(measured[: len(rows), 0]) - set(rows[:, 0]))
    assert 1 <= len(missing) <= 5
    assert missing[-1] - missing[0] == pytest.approx(0.002 * (len(missing) - 1))


def test_in_lockstep_every_change_is_sent_as_it_is():
    messages, measured = sent_in(0.1, lossless=True)
    assert len(messages) == len(measured) + 1  # and that there is none yet
    np.testing.assert_array_equal(received(messages), measured)


@pytest.mark.parametrize("lossless", [False, True])
@pytest.mark.parametrize("kind", ["nan", "lost", "stuck"])
def test_an_imu_that_fails_does_so_at_the_other_end_too(kind, lossless):
    failures = [ImuFailure(kind, 0.1, 0.05)]
    messages, measured = sent_in(0.3, lossless, failures=failures)
    rows = received(messages)
    np.testing.assert_array_equal(rows, measured[: len(rows)])
    is_nan = np.isnan(rows[:, 1:]).any(axis=1)
    assert is_nan.sum() == (25 if kind == "nan" else 0)
    np.testing.assert_array_equal(is_nan, np.isnan(rows[:, 1:]).all(axis=1))


def test_before_the_first_sample():
    messages, _ = sent_in(0.001, lossless=True)
    assert received(messages).size == 0
    np.testing.assert_array_equal(CHANNEL.initial["imu"], NO_SAMPLES)


def test_it_is_there_for_autonomies_that_use_it():
    class Estimator(LeafSystem):
        def __init__(self):
            LeafSystem.__init__(self)
            self.DeclareVectorInputPort("imu", IMU_SIZE)

    builder = DiagramBuilder()
    estimator = builder.AddSystem(Estimator())
    builder.ExportInput(estimator.get_input_port(), "imu")
    builder.ExportOutput(builder.AddSystem(Imu(rate=1.0)).get_output_port(), "other")
    assert ports_wanted(builder.Build()) == ("imu",)


def test_what_tells_the_drone_where_it_is_does_not_cross_the_link_if_nobody_may_know():
    expected = {TRUTH: ("camera_view", "state_estimate"), VIO: ("camera_view", "imu")}
    for estimator, ports in expected.items():
        scenario = Scenario(estimator=estimator)
        wanted = ports_wanted(MakeAutonomy(scenario))
        assert wanted == ports
        names = {row.name for row in make_channels(scenario, wanted)}
        assert ("AIRRACE_STATE_ESTIMATE" in names) == (estimator == TRUTH)
        assert ("AIRRACE_IMU" in names) == (estimator == VIO)
