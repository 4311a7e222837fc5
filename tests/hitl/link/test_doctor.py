"""The doctor's verdicts, and a measurement of a link in memory."""

import dataclasses as dc

import numpy as np
import pytest

from airrace import lcmtypes
from airrace.hitl.link.doctor import diagnose, make_table, refusal
from airrace.hitl.link.endpoint import Endpoint
from airrace.hitl.link.probe import CHANNELS, PICTURE, STATE, LinkFindings, Responder, measure
from airrace.hitl.link.statistics import ChannelStatistics
from airrace.scenario import Scenario
from tests.hitl.link.memory_bus import MemoryBus


def filled(result, **values):
    for name, value in values.items():
        setattr(result, name, value)
    return result


def statistics(**values):
    return filled(lcmtypes.lcmt_channel_statistics(), **values)


PICTURES = statistics(
    received=300, rate=30.0, jitter=0.002, age_p99=0.01, bytes=5e4, decode_time=0.001
)


def findings(pictures=PICTURES, states=statistics(received=5000), buffer=4 << 20, time=30, **link):
    """A good link, with changes."""
    commands = ChannelStatistics()
    commands.received = 5000
    pictures.channel, states.channel = PICTURE, STATE
    good = LinkFindings(
        duration=10.0,
        status=filled(
            lcmtypes.lcmt_link_status(),
            receive_buffer=buffer,
            fragment_time=time,
            fragment_memory=4 << 20,
            channels=[pictures, states],
        ),
        commands=commands,
        ages=np.full(5000, 0.002),
        round_trip=0.001,
        offset=12.5,
        encode_time=0.001,
        picture_rate=30.0,
        state_rate=500.0,
    )
    return dc.replace(good, **link)


def test_a_good_link():
    rows = diagnose(findings())
    assert {row.verdict for row in rows} == {"good"} and refusal(rows) is None
    assert make_table(rows).row_count == len(rows) > 12


@pytest.mark.parametrize(
    "changes, verdict, what, remedy",
    [
        (dict(pictures=statistics(received=200, rate=20.0)), "weak", "pictures lost", "rmem_max"),
        (
            dict(pictures=statistics(received=30, rate=3.0)),
            "bad",
            "pictures that arrive",
            "programs",
        ),
        (dict(states=statistics(received=4000, missing=1000)), "bad", "states lost", "cable"),
        (dict(round_trip=0.05), "weak", "round trip", "cable"),
        (dict(round_trip=0.3), "bad", "round trip", "cable"),
        (dict(ages=np.array([])), "bad", "age of a command's state, median", "cable"),
        (dict(buffer=212992), "weak", "receive buffer there, at most", "sysctl"),
        (dict(encode_time=0.02), "weak", "encoding a picture here", "programs"),
        (
            dict(pictures=statistics(received=200, rate=20.0, bytes=1e5)),
            "bad",
            "memory for torn pictures there",
            "ipfrag_time=1",
        ),
        (
            dict(pictures=statistics(received=150, rate=15.0, bytes=1e5), time=1),
            "weak",
            "memory for torn pictures there",
            "ipfrag_time=1",
        ),
    ],
)
def test_what_falls_short_is_named_with_a_remedy(changes, verdict, what, remedy):
    rows = diagnose(findings(**changes))
    row = next(row for row in rows if row.what == what)
    assert row.verdict == verdict and remedy in row.remedy
    reason = refusal(rows)
    assert (reason is not None) == (verdict == "bad")
    if reason:
        assert (
            reason.startswith("The link cannot carry a race: ")
            and "airrace doctor --link" in reason
        )


def test_one_picture_that_is_lost_in_a_second_refuses_no_race():
    one = statistics(received=29, rate=30.0, bytes=9e4)
    assert refusal(diagnose(findings(pictures=one, duration=1.0))) is None
    four = statistics(received=26, rate=30.0, bytes=9e4)
    assert "torn pictures" in refusal(diagnose(findings(pictures=four, duration=1.0)))


def test_a_link_in_memory_is_measured():
    bus = MemoryBus()
    autonomy = Endpoint("autonomy", CHANNELS, bus)
    responder = Responder(autonomy)
    scenario = Scenario()
    scenario.camera.width, scenario.camera.height = 320, 180

    def poll():
        autonomy.send_heartbeat("waiting", 0.0)

    # The autonomy answers whenever the simulation takes in what came.
    drain = Endpoint.drain

    def drain_and_answer(self):
        drain(self)
        responder.respond()

    Endpoint.drain = drain_and_answer
    try:
        found = measure(bus, scenario, 1.0, poll=poll, patience=5.0)
    finally:
        Endpoint.drain = drain
    assert found.received(PICTURE).received >= 10 and found.received(STATE).received > 100
    assert found.commands.received > 100 and np.median(found.ages) < 0.2
    assert found.received(PICTURE).bytes > 1000 and found.encode_time > 0.0
