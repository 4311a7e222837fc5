"""What an observer tells a log, and who asks it."""

import json

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from airrace.recording import race_events as events
from airrace.recording.log_sink import LogSink
from airrace.recording.race_observer import RaceObserver
from airrace.recording.topics import TOPICS
from airrace.recording.writer import RaceLog
from airrace.scenario import RecordingConfig, Scenario
from airrace.systems.planning.lap_plan import NO_PLAN, LapPlan, PlanSummary
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.sensing.imu_samples import NO_SAMPLES
from airrace.systems.types import (
    Detections,
    ExplorerEvent,
    ExplorerStatus,
    GateCrossing,
    PolicyStatus,
    RefereeStatus,
)
from airrace.track.gate_map import GateMap
from airrace.trajopt.flat_trajectory import FlatTrajectory
from airrace.vehicle.camera_info import make_camera_info

STATE = np.array([1.0, 0, 0, 0, 1, 2, 3, 0, 0, 0, 4, 0, 0])


VALUES = {
    "truth.state": STATE,
    "state_estimate": [0.5, *STATE],
    "filtered_estimate": [0.5, *STATE],
    "disturbance": [0, 0, 1],
    "imu": [0.25, *np.arange(6.0), 0.125, *np.ones(6), *NO_SAMPLES[14:]],
    "reference": np.zeros(18),
    "rotor_speeds": [1, 2, 3, 4],
    "rotor_speed_command": [4, 3, 2, 1],
    "camera_image_time": [0.25],
    "camera_view": CameraView.of(np.tile(np.arange(64, dtype=np.uint8), (36, 1))),
    "camera_info": make_camera_info(width=64, height=36, fov_y=1.0, X_BC=RigidTransform()),
    "detections": Detections(),
    "gate_map": GateMap(),
    "lap_plan": NO_PLAN,
    "explorer_status": ExplorerStatus(),
    "truth.referee_status": RefereeStatus((), False, None, None, 0),
}


class Recording:
    """An observer alone, with values at its ports."""

    def __init__(self, path, more=None, scenario=None, **config):
        self.path, values = path, VALUES | (more or {})
        scenario = scenario or Scenario(recording=RecordingConfig(**config))
        sizes = {
            name: len(value) if isinstance(value, (list, np.ndarray)) else None
            for name, value in values.items()
        }
        self.observer = RaceObserver(sizes, scenario, LogSink(scenario, RaceLog(path)))
        self.simulator = Simulator(self.observer)
        self.fix(**values)

    def fix(self, **values):
        context = self.simulator.get_mutable_context()
        for name, value in values.items():
            is_vector = isinstance(value, (list, np.ndarray))
            fixed = np.array(value, float) if is_vector else Value[object](value)
            self.observer.GetInputPort(name).FixValue(context, fixed)

    def look(self):
        """Returns what whoever flies the race is told."""
        return [*self.observer.look(self.simulator.get_context())]

    def fly(self, until):
        self.simulator.AdvanceTo(until)

    def messages(self) -> dict:
        """Closes the log; returns topic to pairs of time (s) and message."""
        self.observer.close()
        result = {topic: [] for topic in TOPICS}
        with open(self.path, "rb") as file:
            reader, factory = make_reader(file), DecoderFactory()
            for schema, channel, message in reader.iter_messages():
                decode = (
                    json.loads
                    if channel.message_encoding == "json"
                    else (factory.decoder_for("protobuf", schema))
                )
                result[channel.topic].append((message.log_time / 1e9, decode(message.data)))
        return result


@pytest.fixture
def path(tmp_path):
    return tmp_path / "race.mcap"


def test_states_are_written_at_their_rate(path):
    recording = Recording(path, state_rate=20.0, pose_rate=10.0)
    recording.fly(1.01)
    messages = recording.messages()
    for topic in (
        "/state/truth",
        "/state/estimate",
        "/state/filtered",
        "/state/disturbance",
        "/imu",
        "/reference",
        "/reference/acceleration",
        "/rotors/measured",
        "/rotors/command",
    ):
        assert [time for time, _ in messages[topic]] == pytest.approx(np.arange(21) / 20), topic
    assert len(messages["/tf"]) == 11
    truth, estimate = messages["/state/truth"][5][1], messages["/state/estimate"][5][1]
    assert (truth.timestamp.seconds, truth.timestamp.nanos) == (0, 250_000_000)
    assert estimate.timestamp.nanos == 500_000_000  # when it was true
    assert truth.pose.position.z == 3.0 and truth.linear_velocity.x == 4.0
    assert [j.velocity for j in messages["/rotors/command"][0][1].joints] == [4, 3, 2, 1]
    assert messages["/imu"][5][1] == {
        "time": 0.25,
        "angular_velocity": {"x": 0.0, "y": 1.0, "z": 2.0},
        "specific_force": {"x": 3.0, "y": 4.0, "z": 5.0},
    }


def test_samples_of_the_imu_that_are_no_numbers_are_null(path):
    recording = Recording(path)
    recording.fix(imu=np.concatenate([[0.25], np.full(6, np.nan), NO_SAMPLES[7:]]))
    recording.fly(0.001)
    ((_, message),) = recording.messages()["/imu"]
    nothing = dict.fromkeys("xyz")
    assert message == {"time": 0.25, "angular_velocity": nothing, "specific_force": nothing}


def test_pictures_are_as_many_and_as_small_as_wanted(path):
    recording = Recording(path, image_rate=5.0, image_width=32)
    recording.fly(1.01)
    messages = recording.messages()
    assert len(messages["/camera/image"]) == len(messages["/camera/calibration"]) == 6
    image, calibration = messages["/camera/image"][0][1], messages["/camera/calibration"][0][1]
    assert image.timestamp.nanos == calibration.timestamp.nanos == 250_000_000
    picture = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (18, 32) == (calibration.height, calibration.width)


@pytest.mark.parametrize("drawn_before", [False, True])
def test_pictures_are_written_by_the_clock(path, drawn_before):
    """Whatever somebody else has asked the camera for."""
    recording = Recording(path, image_rate=5.0)
    for n in range(31):
        view = CameraView((36, 64), lambda pixels, boxes: None)
        if drawn_before and n % 2:
            view.whole()
        recording.fix(camera_view=view)
        recording.fly((n + 1) / 30 - 1e-3)
    times = [time for time, _ in recording.messages()["/camera/image"]]
    assert times == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_pictures_come_with_what_was_found_in_them(path):
    recording = Recording(path, image_rate=5.0)
    recording.fix(detections=Detections(time=0.2))  # in the picture before this one
    recording.fly(0.5)
    recording.fix(detections=Detections(time=0.25))
    recording.fly(1.01)
    messages = recording.messages()
    later = [time for time, _ in messages["/camera/image"] if time > 0.5]
    assert [time for time, _ in messages["/camera/annotations"]] == later and len(later) == 3


def test_light_draws_no_pictures(path):
    recording = Recording(path, content="light")
    recording.fix(camera_view=CameraView((36, 64), lambda pixels, boxes: pytest.fail("drawn")))
    recording.fly(0.5)
    assert recording.messages()["/camera/image"] == []


def test_what_is_new_is_written_once(path):
    recording = Recording(path, {"path_clock": np.zeros(6)})
    recording.fly(0.05)
    event = ExplorerEvent(0.01, "HOVER", "looking")
    rest = FlatTrajectory.resting([1.0, 2.0, 3.0, 0.5])
    recording.fix(
        detections=Detections(time=0.04),
        gate_map=GateMap(time=0.04),
        explorer_status=ExplorerStatus(events=(event,)),
        lap_plan=LapPlan(1, 0.0, rest, rest, 0.0, PlanSummary()),
        path_clock=[0.04, 0.3, 0.1, 0.0, 0.0, 0.0],
    )
    recording.fly(2.5)
    messages = recording.messages()
    for topic in ("/scene", "/detections", "/detections/rays", "/plan", "/plan/scene"):
        assert len(messages[topic]) == 1, topic
    assert [m["map"]["time_s"] for _, m in messages["/map"]] == [None, 0.04]
    assert [m for _, m in messages["/plan/clock"]] == [{"delay": 0.3, "goes_on": True}]
    lines = [(line.name, line.message) for _, line in messages["/explorer"]]
    assert lines == [("CALIBRATE", "power on"), ("HOVER", "looking")]


def test_an_explorer_without_events(path):
    recording = Recording(path)
    recording.fly(0.1)
    for state in ("MINE", "YOURS"):
        recording.fix(explorer_status=ExplorerStatus(state=state, reason="a", since=0.1))
        recording.fly(recording.simulator.get_context().get_time() + 0.2)
    lines = [line.name for _, line in recording.messages()["/explorer"]]
    assert lines == ["CALIBRATE", "MINE", "YOURS"]


def test_the_map_is_written_when_a_lap_ends(path):
    recording = Recording(path)
    recording.fly(0.1)
    crossing = GateCrossing(time=0.15, gate=1, lap=2, offset=0.1, max_speed=9.0)
    recording.fix(
        **{
            "truth.referee_status": RefereeStatus((crossing,), True, None, 0.15, 0),
            "gate_map": GateMap(time=0.1),
        }
    )
    recording.fly(0.3)
    messages = recording.messages()
    times = [time for time, _ in messages["/map"]]
    assert times == pytest.approx([0.0, 4 / 30])
    assert [m["gate"] for _, m in messages["/referee/crossings"]] == [1]
    lines = [line.message for _, line in messages["/referee"]]
    assert lines[0].startswith("gate 1 of lap 2, 0.10 m") and lines[1:] == ["finished"]


def test_gates_that_move_are_drawn_anew(path):
    scenario = Scenario()
    scenario.disturbances.gate_shift = 1.0
    recording = Recording(path, {"truth.gate_shifts": np.zeros(20)}, scenario)
    recording.fly(0.2)
    shifts = np.zeros(20)
    shifts[0] = 1.0
    recording.fix(**{"truth.gate_shifts": shifts})
    recording.fly(0.4)
    feet = [
        scene.entities[0].cylinders[0].pose.position.x
        for _, scene in recording.messages()["/scene"]
    ]
    assert feet == [20.0, 21.0]


def test_what_is_not_there_is_not_recorded(path):
    log = LogSink(Scenario(), RaceLog(path))
    observer = RaceObserver({"truth.state": 13}, Scenario(), log)
    simulator = Simulator(observer)
    observer.GetInputPort("truth.state").FixValue(simulator.get_mutable_context(), STATE)
    simulator.AdvanceTo(0.5)
    observer.close()
    with open(path, "rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert topics == {"/scene", "/state/truth"}


def test_who_flies_the_race_is_told_what_has_changed_since_it_asked(path):
    more = {
        "truth.contacts": np.zeros(9),
        "rotor_losses": [np.inf] * 4,
        "policy_status": PolicyStatus(),
    }
    recording = Recording(path, more)
    assert [type(event) for event in recording.look()] == [
        events.MapChanged,
        events.ExplorerChanged,
        events.StateSample,
    ]
    recording.fly(0.1)  # what the log is told is told here, too
    crossings = tuple(GateCrossing(0.01 * k, k, 1, 0.1, 9.0) for k in (1, 2))
    gate_map, rest = GateMap(time=0.05), FlatTrajectory.resting([1.0, 2.0, 3.0, 0.5])
    recording.fix(
        **{
            "gate_map": gate_map,
            "lap_plan": LapPlan(1, 0.0, rest, rest, 0.0, None),
            "rotor_losses": [np.inf, 0.07, np.inf, np.inf],
            "policy_status": PolicyStatus(flies=True, since=0.05),
            "truth.contacts": [2, 1, *[0] * 7],
            "truth.referee_status": RefereeStatus(crossings, False, "why", 0.09, 1),
        }
    )
    new_map, plan, policy, lost, contacts, *crossed, over, sample = recording.look()
    assert new_map.gate_map is gate_map and plan.plan.lap == 1
    assert (policy.status.since, policy.what) == (0.05, "the network flies")
    assert (lost.rotor, lost.noticed, contacts.gates, contacts.environment) == (2, 0.07, 2, 1)
    assert tuple(event.crossing for event in crossed) == crossings
    assert over.status.dnf_reason == "why" and sample.truth.position.tolist() == [1, 2, 3]
    assert {(event.time, event.drone) for event in (new_map, over, sample)} == {(0.1, "drone")}
    # As it comes over a link: the same as other objects.
    recording.fix(
        lap_plan=LapPlan(1, 0.0, rest, rest, 0.0, None),
        policy_status=PolicyStatus(flies=True, since=0.05),
    )
    assert [type(event) for event in recording.look()] == [events.StateSample]


def test_a_crash_costs_no_more_than_a_flush_period(path):
    recording = Recording(path, flush_period=0.25)
    recording.fly(1.1)
    from airrace.analysis.log import is_complete, read_log

    assert not is_complete(path)
    times = [time for topic, time, _ in read_log(path) if topic == "/state/truth"]
    assert 0.96 <= max(times) <= 1.1
