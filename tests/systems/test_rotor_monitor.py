"""The rotor monitor: quick to notice a rotor that stops, and never without cause."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from airrace.systems.rotor_monitor import RotorMonitor
from airrace.vehicle import load_vehicle

RATE = 500.0
STEP = 0.001  # s, of the rotors; two to a period
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
DEFAULT = VEHICLES["Default"]
GREATEST = DEFAULT.max_speeds[0]


def watch(commands, *, delay=0.0, stops=(), report=lambda time, speeds: speeds, vehicle=DEFAULT):
    """Lets a monitor watch rotors; returns all rotor_losses, one a period.

    As in the flight: what changes at a time is seen after it.

    Args:
        commands: one a period, (N, n).
        delay: until they reach the rotors (s).
        stops: pairs of a rotor and when it stops (s).
        report: from time and true speeds to what is reported.
    """
    monitor = RotorMonitor(vehicle=vehicle, rate=RATE)
    context = monitor.CreateDefaultContext()
    blend = 1.0 - np.exp(-STEP / vehicle.rotor_lag)
    speeds = np.zeros(commands.shape[1])
    sent = [speeds] * (1 + round(delay / STEP))
    losses = []
    for k, command in enumerate(commands):
        time = k / RATE
        context.SetTime(time)
        monitor.GetInputPort("rotor_speed_command").FixValue(context, sent[-1])
        monitor.GetInputPort("rotor_speeds").FixValue(context, report(time, speeds))
        context.SetDiscreteState(monitor.EvalUniquePeriodicDiscreteUpdate(context))
        losses.append(monitor.GetOutputPort("rotor_losses").Eval(context).copy())
        for half in range(2):
            arrived = sent[-1 - round(delay / STEP)].copy()
            for rotor, stop in stops:
                if time + half * STEP >= stop - 1e-9:
                    arrived[rotor] = 0.0
            speeds = speeds + blend * (arrived - speeds)
            sent.append(command)
    return np.array(losses)


def steady(share, seconds, vehicle=DEFAULT):
    return np.tile(share * vehicle.max_speeds, (round(seconds * RATE), 1))


@pytest.mark.parametrize("drone", VEHICLES)
@given(data=st.data())
def test_a_rotor_that_stops_is_noticed_within_20_ms(drone, data):
    vehicle = VEHICLES[drone]
    share = data.draw(st.floats(0.25, 1.0))
    rotor = data.draw(st.integers(0, len(vehicle.rotors) - 1))
    stop = 0.3 + STEP * data.draw(st.integers(0, 10))
    delay = STEP * data.draw(st.integers(0, 30))
    losses = watch(steady(share, 0.4, vehicle), delay=delay, stops=[(rotor, stop)], vehicle=vehicle)
    found = losses[-1]
    assert stop < found[rotor] <= stop + 0.020
    assert np.all(np.isinf(np.delete(found, rotor)))
    # The time is that of the update that found it.
    first = np.flatnonzero(np.isfinite(losses[:, rotor]))[0]
    assert found[rotor] == pytest.approx(first / RATE)


@st.composite
def command_histories(draw):
    """Of steps of any height, as bold as those of a controller."""
    heights = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
    steps = draw(st.lists(
        st.tuples(st.lists(heights, min_size=4, max_size=4), st.integers(1, 60)), max_size=12))
    rows = [row for row, periods in steps for _ in range(periods)]
    return GREATEST * np.array(rows).reshape(-1, 4)


@given(command_histories(), st.integers(0, 30))
@example(np.repeat([GREATEST * np.ones(4), np.zeros(4)], 100, axis=0), 30)
@example(np.tile([GREATEST * np.ones(4), np.zeros(4)], (100, 1)), 30)
def test_healthy_rotors_never_give_an_alarm(commands, delay):
    if len(commands):
        assert np.all(np.isinf(watch(commands, delay=STEP * delay)))


def test_a_delay_that_is_longer_is_no_promise():
    """The bound is a real one: at twice the delay there are alarms."""
    commands = np.repeat([np.zeros(4), GREATEST * np.ones(4)], 50, axis=0)
    assert np.any(np.isfinite(watch(commands, delay=0.060)))


@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_a_speed_that_is_no_number_is_a_loss(bad):
    def report(time, speeds):
        return np.where((np.arange(4) == 2) & (time >= 0.3), bad, speeds)

    losses = watch(steady(0.5, 0.4), report=report)[-1]
    assert 0.3 < losses[2] <= 0.310
    assert np.all(np.isinf(losses[[0, 1, 3]]))


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_one_bad_reading_is_no_loss(value):
    def report(time, speeds):
        return np.where(abs(time - 0.3) < 0.5 / RATE, value, speeds)

    assert np.all(np.isinf(watch(steady(0.5, 0.4), report=report)))


def test_a_loss_is_for_good():
    """And its time is the first, whatever the rotor reports later."""
    def report(time, speeds):
        return np.where((np.arange(4) == 1) & (0.3 <= time < 0.33), 0.0, speeds)

    losses = watch(steady(0.5, 1.0), report=report)
    found = losses[losses[:, 1] < np.inf, 1]
    assert len(found) > 300 and np.all(found == found[0])
    assert np.all(np.isinf(losses[:, [0, 2, 3]]))


def test_rotors_at_rest_are_not_lost():
    """Before take-off, on the way up, and when they idle."""
    commands = np.vstack([steady(0.0, 0.5), steady(0.6, 0.3), steady(0.0, 0.5), steady(0.15, 0.5)])
    for delay in (0.0, 0.03):
        assert np.all(np.isinf(watch(commands, delay=delay)))


@pytest.mark.parametrize("share, found", [(0.19, False), (0.21, True)])
def test_below_a_fifth_of_the_greatest_speed_there_is_nothing_to_tell_by(share, found):
    def report(time, speeds):
        return np.full(4, np.nan)

    losses = watch(steady(share, 0.5), report=report)[-1]
    assert np.all(np.isfinite(losses) == found)


def test_a_rotor_that_never_starts_is_noticed_at_the_start():
    commands = np.vstack([steady(0.0, 0.5), steady(0.6, 0.3)])
    losses = watch(commands, stops=[(3, 0.0)])[-1]
    assert 0.5 < losses[3] < 0.6 and np.all(np.isinf(losses[:3]))


def test_all_rotors_can_be_lost_one_by_one():
    stops = [(i, 0.3 + 0.1 * i) for i in range(4)]
    losses = watch(steady(0.5, 0.8), stops=stops)[-1]
    for rotor, stop in stops:
        assert stop < losses[rotor] <= stop + 0.020


def test_who_comes_back_does_not_judge_at_once():
    """Until its own commands arrive, the rotors do what somebody else commands."""
    monitor = RotorMonitor(vehicle=DEFAULT, rate=RATE)
    context = monitor.CreateDefaultContext()
    lost_after = None
    for k in range(700):
        time = 5.0 + k / RATE
        context.SetTime(time)
        monitor.GetInputPort("rotor_speed_command").FixValue(context, DEFAULT.max_speeds)
        monitor.GetInputPort("rotor_speeds").FixValue(context, 0.5 * DEFAULT.max_speeds)
        context.SetDiscreteState(monitor.EvalUniquePeriodicDiscreteUpdate(context))
        losses = monitor.GetOutputPort("rotor_losses").Eval(context)
        if lost_after is None and np.isfinite(losses).any():
            lost_after = time - 5.0
    assert lost_after == pytest.approx(1.0, abs=0.01)
