"""The rotor monitor: quick to notice a rotor that stops, and never without cause."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydrake.systems.framework import DiagramBuilder

from airrace.systems.failsafe.rotor_monitor import RotorMonitor
from airrace.systems.plant.rotor_bank import RotorBank
from airrace.vehicle import load_vehicle

RATE = 200.0
STEP = 0.0025  # s, of the rotors; two to a period
VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}
DEFAULT = VEHICLES["Default"]
GREATEST = DEFAULT.max_speeds[0]


def reports_of(commands, *, arrivals=None, stops=(), vehicle=DEFAULT):
    """Lets rotors turn; returns their reports, one a period, (N, 1 + 2n).

    Args:
        commands: one a period, (N, n).
        arrivals: which of them is in force in each period, (N,); each in its own, unless given.
        stops: pairs of a rotor and when it stops (s).
    """
    bank = RotorBank(vehicle=vehicle, period=STEP, failures=stops)
    builder = DiagramBuilder()
    builder.AddSystem(bank)
    builder.ExportInput(bank.GetInputPort("rotor_speed_command"), "command")
    builder.ExportOutput(bank.GetOutputPort("rotor_status"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    reports = []
    for k in range(len(commands)):
        reports.append(diagram.get_output_port().Eval(context))
        which = k if arrivals is None else arrivals[k]
        diagram.get_input_port().FixValue(context, commands[which])
        for half in range(2):
            context.SetTime(k / RATE + half * STEP)
            context.SetDiscreteState(diagram.EvalUniquePeriodicDiscreteUpdate(context))
    return np.array(reports).reshape(len(commands), -1)


def judge(reports, vehicle=DEFAULT):
    """Lets a monitor look at reports, one a period; returns all rotor_losses, (N, n)."""
    monitor = RotorMonitor(vehicle=vehicle, rate=RATE)
    context = monitor.CreateDefaultContext()
    losses = []
    for k, report in enumerate(reports):
        context.SetTime(k / RATE)
        monitor.get_input_port().FixValue(context, report)
        context.SetDiscreteState(monitor.EvalUniquePeriodicDiscreteUpdate(context))
        losses.append(monitor.get_output_port().Eval(context).copy())
    return np.array(losses)


def watch(commands, *, report=lambda time, speeds: speeds, vehicle=DEFAULT, **others):
    """Returns all rotor_losses, with reported speeds changed. For the others, see reports_of()."""
    reports = reports_of(commands, vehicle=vehicle, **others)
    n = len(vehicle.rotors)
    for r in reports:
        r[1 : 1 + n] = report(r[0], r[1 : 1 + n])
    return judge(reports, vehicle)


def steady(share, seconds, vehicle=DEFAULT):
    return np.tile(share * vehicle.max_speeds, (round(seconds * RATE), 1))


@pytest.mark.slow
@pytest.mark.parametrize("drone", VEHICLES)
@given(data=st.data())
def test_a_rotor_that_stops_is_noticed_within_20_ms(drone, data):
    vehicle = VEHICLES[drone]
    share = data.draw(st.floats(0.25, 1.0))
    rotor = data.draw(st.integers(0, len(vehicle.rotors) - 1))
    stop = 0.3 + STEP * data.draw(st.integers(0, 10))
    losses = watch(steady(share, 0.4, vehicle), stops=[(rotor, stop)], vehicle=vehicle)
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
    steps = draw(
        st.lists(
            st.tuples(st.lists(heights, min_size=4, max_size=4), st.integers(1, 60)), max_size=12
        )
    )
    rows = [row for row, periods in steps for _ in range(periods)]
    return GREATEST * np.array(rows).reshape(-1, 4)


@pytest.mark.slow
@given(command_histories(), st.data())
@example(np.repeat([GREATEST * np.ones(4), np.zeros(4)], 100, axis=0), None)
@example(np.tile([GREATEST * np.ones(4), np.zeros(4)], (100, 1)), None)
def test_healthy_rotors_never_give_an_alarm(commands, data):
    """However late commands and reports are, and however many of them get lost."""
    if not len(commands):
        return
    arrivals = arrived = None
    if data:
        random = np.random.Generator(np.random.PCG64(data.draw(st.integers(0, 99))))
        arrivals, arrived = (
            newest_arrived(
                len(commands),
                random,
                data.draw(st.integers(0, 300)),
                data.draw(st.floats(0.0, 0.98)),
            )
            for _ in range(2)
        )
    reports = reports_of(commands, arrivals=arrivals)
    assert np.all(np.isinf(judge(reports if arrived is None else reports[arrived])))


def newest_arrived(count, random, latest, lost):
    """Returns which of some messages, one a period, is known in each period, (count,).

    Args:
        latest: delay (periods).
        lost: share.
    """
    arrives = np.arange(count) + random.integers(0, latest + 1, count)
    arrives[random.random(count) < lost] = count
    return np.array([max(np.flatnonzero(arrives <= k), default=0) for k in range(count)])


def test_whose_commands_the_rotors_follow_makes_no_difference():
    """As when a watchdog hovers: what the autonomy would like is not what it expects."""
    ours = np.tile(GREATEST * np.array([[0.9], [0.5]]), (500, 4))
    held = np.arange(len(ours))
    held[200:800] = 200
    assert np.all(np.isinf(watch(ours, arrivals=held)))
    losses = watch(ours, arrivals=held, stops=[(2, 1.0)])[-1]
    assert 1.0 < losses[2] <= 1.020 and np.all(np.isinf(losses[[0, 1, 3]]))


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
    assert len(found) > 0.6 * RATE and np.all(found == found[0])
    assert np.all(np.isinf(losses[:, [0, 2, 3]]))


def test_rotors_at_rest_are_not_lost():
    """Before take-off, on the way up, and when they idle."""
    commands = np.vstack([steady(0.0, 0.5), steady(0.6, 0.3), steady(0.0, 0.5), steady(0.15, 0.5)])
    assert np.all(np.isinf(watch(commands)))


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


def test_one_bad_reading_that_stays_the_newest_is_no_loss():
    """The link broke after it."""
    reports = reports_of(steady(0.5, 0.4))
    bad = round(0.3 * RATE)
    reports[bad, 2] = 0.0
    reports[bad:] = reports[bad]
    assert np.all(np.isinf(judge(reports)))


def test_two_bad_readings_with_a_pause_between_are_a_loss():
    reports = reports_of(steady(0.5, 0.4), stops=[(1, 0.28)])
    first, second = round(0.288 * RATE), round(0.34 * RATE)
    reports[first:second] = reports[first]
    losses = judge(reports)[:, 1]
    assert np.all(np.isinf(losses[:second])) and losses[second] == second / RATE
