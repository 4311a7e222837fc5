"""Writes a race to race.mcap while it is flown, and to Foxglove."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airrace.common.resources import find_yaml
from airrace.recording import foxglove_messages as messages
from airrace.recording import json_topics, scene_updates
from airrace.recording import race_events as events
from airrace.recording.topics import SAMPLED
from airrace.recording.writer import FILE, RaceLog
from airrace.scenario import Scenario, scenario_yaml
from airrace.scenario.lap_limits import parse_limits
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.types import Detections
from airrace.track import Course, load_track
from airrace.vehicle import find_vehicle, load_vehicle

if TYPE_CHECKING:
    from airrace.recording.foxglove_server import FoxgloveServer

# s, between two points of the path, and between two messages of it; how many points of the past.
_POINT_PERIOD, _PATH_PERIOD, _PATH_POINTS = 0.1, 1.0, 150
_EARLY = 1e-6  # s, by which a clock that was added up may be late
_OLD_PLANS = 3  # shown beside the one in force
_FAST = 40.0  # m/s, shown red at most


class LogSink:
    """A sink that writes events to the topics of a RaceLog; topics.py says which there are."""

    def __init__(self, scenario: Scenario, log: RaceLog):
        """Args: scenario: the race. log: to write to; close() closes it."""
        self._log, self._config = log, scenario.recording
        self._track, self._vehicle = load_track(scenario.track), load_vehicle(scenario.drone)[0]
        self._max_speed = min(parse_limits(scenario.planner.limits)[0], _FAST)
        self._detections, self._plans = Detections(), list[LapPlan]()
        self._path = list[tuple[list[float], float]]()
        self._next_point = self._next_path = 0.0
        self._next_flush = self._config.flush_period
        if not scenario.disturbances.gate_shift:  # else an event says where they stand
            self._write_scene(0.0, self._track)

    def close(self) -> None:
        """Ends the file."""
        self._log.close()

    @functools.singledispatchmethod
    def take(self, event: events.RaceEvent) -> None:
        """Writes an event; of most kinds there is a method below."""

    @take.register
    def _(self, event: events.StateSample) -> None:
        for topic, (_, field, encode) in SAMPLED.items():
            if (value := getattr(event, field)) is not None:
                self._log.write(topic, event.time, encode(event.time, value, self._vehicle))
        if event.time >= self._next_flush:
            self._next_flush = event.time + self._config.flush_period - _EARLY
            self._log.flush()

    @take.register
    def _(self, event: events.PoseSample) -> None:
        time, truth = event.time, event.truth
        self._log.write("/tf", time, messages.transforms(truth, event.X_BC))
        if time >= self._next_point:
            self._next_point = time + _POINT_PERIOD - _EARLY
            point = truth.position.tolist(), float(np.linalg.norm(truth.velocity))
            self._path = [*self._path[1 - _PATH_POINTS :], point]
        if time >= self._next_path:
            self._next_path = time + _PATH_PERIOD - _EARLY
            positions, speeds = zip(*self._path)
            scene = scene_updates.path_scene(time, positions, speeds, self._max_speed)
            self._log.write("/path", time, scene)

    @take.register
    def _(self, event: events.ImuSampled) -> None:
        self._log.write("/imu/samples", event.time, json_topics.imu_samples_data(event.samples))

    @take.register
    def _(self, event: events.DetectionsSeen) -> None:
        self._detections = seen = event.detections
        self._log.write("/detections", event.time, json_topics.detections_data(seen))
        self._log.write("/detections/rays", event.time, scene_updates.detection_rays(seen))

    @take.register
    def _(self, event: events.Picture) -> None:
        if self._config.content != "full":
            return
        time, write, info = event.time, self._log.write, event.info
        scale = min(1.0, self._config.image_width / info.width)
        jpeg = messages.jpeg(event.view.whole(), scale, self._config.jpeg_quality)
        write("/camera/image", time, messages.image(event.taken, jpeg))
        write("/camera/calibration", time, messages.calibration(event.taken, info, scale))
        if self._detections.time == event.taken:
            annotations = messages.annotations(self._detections, info, scale)
            write("/camera/annotations", time, annotations)

    @take.register
    def _(self, event: events.EstimateMade) -> None:
        if event.slam is not None:
            data = json_topics.estimator_data(event.slam, event.error)
            self._log.write("/estimator", event.time, data)

    @take.register
    def _(self, event: events.MapChanged) -> None:
        self._log.write("/map", event.time, json_topics.full_map_data(event.gate_map))
        scene = scene_updates.map_scene(event.time, event.gate_map)
        self._log.write("/map/scene", event.time, scene)

    @take.register
    def _(self, event: events.PlanMade) -> None:
        self._plans = [*self._plans[-_OLD_PLANS:], event.plan]
        self._log.write("/plan", event.time, json_topics.plan_data(event.plan))
        scene = scene_updates.plan_scene(event.time, self._plans)
        self._log.write("/plan/scene", event.time, scene)

    @take.register
    def _(self, event: events.ClockWaits) -> None:
        data = {"delay": event.delay, "goes_on": event.goes_on}
        self._log.write("/plan/clock", event.time, data)

    @take.register
    def _(self, event: events.ExplorerChanged) -> None:
        data = json_topics.status_data(event.status, event.entered)
        self._log.write("/explorer/status", event.time, data)
        for each in event.entered:
            message = messages.log(each.time, each.state, each.reason)
            self._log.write("/explorer", event.time, message)

    @take.register
    def _(self, event: events.GateCrossed) -> None:
        crossing = event.crossing
        words = (
            f"gate {crossing.gate} of lap {crossing.lap}, {crossing.offset:.2f} m from its "
            f"midpoint, at most {crossing.max_speed:.1f} m/s since the one before"
        )
        self._log.write("/referee", event.time, messages.log(crossing.time, "gate", words))
        self._log.write("/referee/crossings", event.time, json_topics.crossing_data(crossing))

    @take.register
    def _(self, event: events.RaceOver) -> None:
        status = event.status
        assert status.end_time is not None
        reason = status.dnf_reason or "finished"
        message = messages.log(status.end_time, "over", reason, bad=not status.finished)
        self._log.write("/referee", event.time, message)

    @take.register
    def _(self, event: events.GatesMoved) -> None:
        self._write_scene(event.time, self._track.shifted(event.shifts))

    def _write_scene(self, time: float, track: Course) -> None:
        scene = scene_updates.track_scene(time, track, self._vehicle)
        self._log.write("/scene", time, scene)


def MakeLogSink(
    scenario: Scenario, output_dir: Path, live: "FoxgloveServer | None" = None
) -> LogSink | None:
    """Returns what writes race.mcap, unless the scenario wants none, and serves the same live.

    Args:
        scenario: the race.
        output_dir: where the file goes.
        live: that gets all messages, too.

    Raises:
        UserError: if it cannot be written.
    """
    recorded = scenario.recording.content != "none"
    if not recorded and live is None:
        return None
    log = RaceLog(Path(output_dir) / FILE if recorded else None, live)
    log.attach("scenario.yaml", scenario_yaml(scenario))
    log.attach("track.yaml", find_yaml("tracks", scenario.track).read_text(encoding="utf-8"))
    log.attach("vehicle.yaml", find_vehicle(scenario.drone).read_text(encoding="utf-8"))
    return LogSink(scenario, log)
