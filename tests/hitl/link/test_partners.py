"""Who takes whom for its other side: by the race, and by what both share."""

import json

import pytest

from airrace.common.errors import UserError
from airrace.hitl.link import partners, phases
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Endpoint
from airrace.hitl.link.link_key import UNSIGNED
from airrace.hitl.link.lockstep import await_peer
from airrace.hitl.link.partners import Partner, first_difference
from airrace.hitl.link.simulated_bus import LinkConfig, SimulatedLink

RACE, OTHER_RACE = "0" * 31 + "1", "0" * 31 + "2"
URL = "udpm://239.255.76.67:7667?ttl=0"


class Network:
    """Ends of one link, each of which beats in its phase as long as it is not paused."""

    def __init__(self):
        self.link, self.ends, self.phases = SimulatedLink(LinkConfig()), [], {}

    def add(self, role, phase, **me):
        result = Endpoint(role, [], self.link.bus(), self.link.clock, me=Partner(**me, url=URL))
        self.ends.append(result)
        self.phases[result] = phase
        result.wait = lambda timeout: self.run(timeout, result)
        return result

    def run(self, duration, *paused):
        """Lets time pass (s) for all but those that are paused."""
        end = self.link.time + duration
        while self.link.time < end:
            self.link.time += 0.01
            for one in self.ends:
                if one not in paused:
                    one.drain()
                    one.beat(self.phases[one], 0.0)

    def race(self):
        """Adds a simulation and an autonomy that race, and returns them."""
        simulation = self.add(SIMULATION, phases.READY, race=RACE)
        autonomy = self.add(AUTONOMY, phases.WAITING)
        self.run(0.5)
        autonomy.join(simulation.partners.me.race)
        self.phases[simulation] = self.phases[autonomy] = phases.RACING
        self.run(0.5)
        assert simulation.peer == autonomy.session and autonomy.peer == simulation.session
        return simulation, autonomy


@pytest.fixture
def network():
    return Network()


def test_an_autonomy_that_waits_takes_no_race_from_another(network):
    simulation, autonomy = network.race()
    network.add(AUTONOMY, phases.WAITING)
    network.run(1.0)
    network.run(0.45, autonomy)  # as by SIGSTOP; silent for 0.3 s is enough without a race
    assert simulation.silence > 0.3
    network.run(2.0)
    assert simulation.peer == autonomy.session and simulation.silence < 0.1


def test_a_simulation_that_waits_takes_no_autonomy_from_another(network):
    simulation, autonomy = network.race()
    network.add(SIMULATION, phases.WAITING, race=OTHER_RACE)
    network.run(5.2, simulation)
    assert autonomy.silence > 5.0  # its rule: then it ends
    assert autonomy.peer == simulation.session


def test_who_goes_on_with_the_checkpoint_of_the_race_is_taken(network):
    simulation, autonomy = network.race()
    network.ends.remove(autonomy)
    network.run(1.0)
    stranger = network.add(AUTONOMY, phases.WAITING, race=OTHER_RACE, resumes=True)
    network.run(1.0)
    assert simulation.peer == autonomy.session and stranger.peer == 0
    second = network.add(AUTONOMY, phases.WAITING, race=RACE, resumes=True)
    network.run(1.0)
    assert simulation.peer == second.session and second.peer == simulation.session


def test_before_a_race_an_autonomy_may_be_started_again(network):
    simulation = network.add(SIMULATION, phases.READY, race=RACE)
    first = network.add(AUTONOMY, phases.WAITING)
    network.run(0.5)
    network.ends.remove(first)
    second = network.add(AUTONOMY, phases.WAITING)
    network.run(1.0)
    assert simulation.peer == second.session


def test_the_navigator_leaves_a_simulation_whose_race_it_is_not(network):
    """Both halves of an autonomy hear for themselves, and one may have taken another."""
    autonomy = network.add(AUTONOMY, phases.WAITING)
    wrong = network.add(SIMULATION, phases.WAITING, race=OTHER_RACE)
    network.run(0.5)
    assert autonomy.peer == wrong.session
    right = network.add(SIMULATION, phases.READY, race=RACE)
    autonomy.join(RACE)
    assert autonomy.peer == 0
    network.run(1.0)
    assert autonomy.peer == right.session


@pytest.mark.parametrize("role", [SIMULATION, AUTONOMY])
def test_a_second_one_is_told_of_the_race(network, role):
    network.race()
    late = network.add(role, phases.WAITING, race=OTHER_RACE if role == SIMULATION else "")
    begun = network.link.time
    with pytest.raises(UserError) as caught:
        await_peer(late, phases.WAITING, expected="never", timeout=60.0)
    assert str(caught.value).startswith(
        f"Another race is on at this URL ({URL}): wait for its end or give another --lcm_url"
    )
    assert ("--resume" in str(caught.value)) == (role == AUTONOMY)
    assert network.link.time - begun == pytest.approx(6.1, abs=0.2)


def test_a_race_whose_simulation_has_just_been_killed_is_waited_for(network):
    """Its autonomy ends by itself, 5 s later."""
    simulation, autonomy = network.race()
    network.ends.remove(simulation)
    late = network.add(SIMULATION, phases.WAITING, race=OTHER_RACE)
    network.run(5.0, late)
    network.ends.remove(autonomy)
    network.add(AUTONOMY, phases.WAITING)
    await_peer(late, phases.WAITING, timeout=60.0)


def test_a_checkpoint_of_another_race(network):
    network.race()
    late = network.add(AUTONOMY, phases.WAITING, race=OTHER_RACE, resumes=True)
    with pytest.raises(UserError, match="is not the one of the checkpoint: start without --resume"):
        await_peer(late, phases.WAITING, expected=phases.RACING, timeout=60.0)


def differing(network, theirs, here):
    """Returns what the simulation and the autonomy say of each other, and how long it took (s)."""
    ends = {
        SIMULATION: network.add(SIMULATION, phases.WAITING, race=RACE, shared=here),
        AUTONOMY: network.add(AUTONOMY, phases.WAITING, shared=theirs),
    }
    said, begun = {}, network.link.time
    for role, end in ends.items():  # the second one after the first has ended
        with pytest.raises(UserError) as caught:
            await_peer(end, phases.WAITING, timeout=30.0)
        said[role] = str(caught.value)
        network.ends.remove(end)
    return said, network.link.time - begun


def test_scenarios_that_differ_are_told_on_both_sides_at_once(network):
    here = {"estimator": "truth", "camera.width": 640, "camera.height": 360}
    there = here | {"camera.width": 320, "camera.height": 240}
    said, after = differing(network, there, here)
    assert said[SIMULATION] == (
        "The autonomy has another scenario: camera.width 320, here 640; start both with the same "
        "one."
    )
    assert said[AUTONOMY].startswith(
        "The simulation has another scenario: camera.width 640, here 320;"
    )
    assert after < 0.5


def test_versions_that_differ(network):
    simulation = network.add(SIMULATION, phases.WAITING, race=RACE, shared={"a": 1})
    autonomy = network.add(AUTONOMY, phases.WAITING, shared={"a": 1})
    introduce = autonomy.partners.introduce

    def of_tomorrow(message, now):
        introduce(message, now)
        message.version = "9.0\x1b"

    autonomy.partners.introduce = of_tomorrow
    with pytest.raises(UserError, match=r"The autonomy is of airrace 9.0\\x1b, here is"):
        await_peer(simulation, phases.WAITING, timeout=30.0)


def test_one_who_differs_does_not_disturb_two_who_have_met(network):
    network.add(AUTONOMY, phases.WAITING, shared={"a": 2})
    simulation = network.add(SIMULATION, phases.WAITING, race=RACE, shared={"a": 1})
    autonomy = network.add(AUTONOMY, phases.WAITING, shared={"a": 1})
    await_peer(simulation, phases.WAITING, timeout=30.0)
    begun = network.link.time

    def get_ready():
        if network.link.time > begun + 2.0:
            network.phases[autonomy] = phases.READY

    await_peer(simulation, phases.READY, timeout=30.0, poll=get_ready)
    assert simulation.peer == autonomy.session


def test_what_is_shared_is_said_only_where_it_differs(network):
    simulation = network.add(SIMULATION, phases.WAITING, shared={"a": 1})
    autonomy = network.add(AUTONOMY, phases.WAITING, shared={"a": 1})
    network.run(0.5)
    heard = simulation.peer_heartbeat.value
    assert heard.digest == autonomy.partners.me.digest != "" and heard.shared == ""


@pytest.mark.parametrize(
    "text, difference",
    [
        ('{"a":1,"b":"x"}', "b x, here y"),
        ('{"a":1}', "b nothing, here y"),
        ('{"a":1,"b":"y","c":null}', "c null, here nothing"),
        ('{"a":1,"b":"\\u001b[2J"}', r"b \x1b[2J, here y"),
        ('{"b":"y","a":1}', "the order of its fields"),
        ("[" * 100_000, "what it says of it cannot be read"),
        ("[1]", "what it says of it cannot be read"),
        ("7", "what it says of it cannot be read"),
        (json.dumps({"a": "x" * partners._MOST_SHARED}), "what it says of it cannot be read"),
    ],
)
def test_the_first_field_that_differs(text, difference):
    assert first_difference(text, Partner(shared={"a": 1, "b": "y"})) == difference


def test_one_that_is_there_but_does_not_get_ready(network):
    simulation = network.add(SIMULATION, phases.READY, race=RACE)
    autonomy = network.add(AUTONOMY, phases.WAITING)
    beat = autonomy.beat
    autonomy.beat = lambda phase, time: beat(phase, time, "nothing has come on AIRRACE_CAMERA")
    with pytest.raises(UserError) as caught:
        await_peer(simulation, phases.READY, timeout=5.0)
    assert str(caught.value).startswith(
        "The autonomy runs, but does not get ready within 5 s: it says waiting: nothing has come "
        "on AIRRACE_CAMERA; see what it prints."
    )
    assert "cable" not in str(caught.value)


def test_heartbeats_of_another_airrace(network):
    simulation = network.add(SIMULATION, phases.WAITING, race=RACE)
    network.link.send("AIRRACE_HEARTBEAT", b"as another version writes them")
    with pytest.raises(UserError, match="heartbeats of another airrace: give both sides the same"):
        await_peer(simulation, phases.WAITING, timeout=5.0)


@pytest.mark.parametrize("said", ['[[1,2],["a",3]]', '[["estimator","truth"],[5,6]]', "7", "null"])
def test_fields_that_are_none(said):
    me = Partner(shared={"estimator": "truth"})
    assert first_difference(said, me) == "what it says of it cannot be read"


def test_what_is_not_signed_is_no_cable(network):
    simulation = network.add(SIMULATION, phases.WAITING, race=RACE)
    simulation._bus.summary = lambda: {"received": 7, "dropped": {UNSIGNED: 7}}
    with pytest.raises(UserError, match="not signed with this --link_key: give both sides"):
        await_peer(simulation, phases.WAITING, timeout=2.0)
