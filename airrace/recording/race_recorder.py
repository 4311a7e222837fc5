"""Writes race.mcap as the race goes on."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Diagram, DiagramBuilder

from airrace.common.resources import find_yaml
from airrace.recording import foxglove_messages as messages
from airrace.recording import json_topics, scene_updates
from airrace.recording.topics import SAMPLED
from airrace.recording.writer import FILE, RaceLog
from airrace.scenario import VIO, Scenario, scenario_yaml
from airrace.scenario.lap_limits import parse_limits
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.sensing.imu_samples import IMU_DEPTH, IMU_SIZE
from airrace.track import load_track
from airrace.trajopt.reference import REFERENCE_SIZE
from airrace.vehicle import find_vehicle, load_vehicle
from airrace.vehicle.state import STATE_SIZE, as_plant_state, as_state

if TYPE_CHECKING:
    from airrace.recording.foxglove_server import FoxgloveServer
    from airrace.systems.types import RefereeStatus

_NAME = "race_recorder"
_MAP_PERIOD = 1.0  # s between two writes of a map that changed
_PATH_RATE, _PATH_POINTS = 10.0, 150  # Hz; how many points of the past the path shows
_OLD_PLANS = 3  # shown beside the one in force
_FAST = 40.0  # m/s, shown red at most


class RaceRecorder(LeafSystem):
    """Writes what crosses a race's ports to a log; topics.py says where to, and when.

    .. pydrake_system::

        name: RaceRecorder
        input_ports:
        - truth.state
        - state_estimate
        - filtered_estimate
        - disturbance
        - imu
        - reference
        - rotor_speeds
        - rotor_speed_command
        - camera_view (only if pictures are recorded)
        - camera_image_time (only if pictures are recorded)
        - camera_info
        - detections
        - gate_map
        - lap_plan
        - explorer_status
        - truth.referee_status
        - truth.gate_shifts (only if gates move)
        - slam_state (only with vio)

    All are as the systems that they come from describe them. What is not connected is
    not recorded. Everything is written by the clock. Nothing in the race depends on it:
    it only publishes, and what it remembers is what the file holds already.
    """

    def __init__(self, *, scenario: Scenario, log: RaceLog, moving_gates: bool = False):
        """Constructs the recorder.

        Args:
            scenario: the race.
            log: to write to; close() closes it.
            moving_gates: whether there is a port ``truth.gate_shifts``.
        """
        LeafSystem.__init__(self)
        self._log, self._config = log, scenario.recording
        self._track, self._vehicle = load_track(scenario.track), load_vehicle(scenario.drone)[0]
        self._max_speed = min(parse_limits(scenario.planner.limits)[0], _FAST)
        pictures = self._config.content == "full"
        estimates = scenario.estimator == VIO
        self._declare_ports(pictures, moving_gates, estimates)
        # Of what was written last. It is output, not state: see the class.
        self._written, self._map_time = {}, -np.inf
        self._path, self._plans = [], []
        self._start, self._events, self._crossings = None, 0, 0
        self._newest_sample, self._estimated = -1.0, -1.0
        config, fps = self._config, scenario.camera.fps
        for period, write in (
            (1 / config.state_rate, self._write_states),
            (1 / config.pose_rate, self._write_poses),
            (1 / _PATH_RATE, self._extend_path),
            (1.0, self._write_path),
            (1 / fps, self._write_changes),
            *([(1 / config.image_rate, self._write_image)] if pictures else []),
            # Often enough that each sample is in the port's vector at least once.
            *([(IMU_DEPTH / 2 / scenario.imu.rate, self._write_samples)] if estimates else []),
            (config.flush_period, lambda context: self._log.flush()),
        ):
            self.DeclarePeriodicPublishEvent(period, 0.0, write)

    def _declare_ports(self, pictures, moving_gates, estimates):
        n = len(self._vehicle.rotors)
        vectors = {
            "truth.state": STATE_SIZE - 1,
            "state_estimate": STATE_SIZE,
            "filtered_estimate": STATE_SIZE,
            "disturbance": 3,
            "imu": IMU_SIZE,
            "reference": REFERENCE_SIZE,
            "rotor_speeds": n,
            "rotor_speed_command": n,
        }
        values = ["camera_info", "detections", "gate_map", "lap_plan", "explorer_status"]
        values += ["truth.referee_status"]
        if pictures:
            vectors["camera_image_time"] = 1
            values += ["camera_view"]
        if estimates:
            values += ["slam_state"]
        if moving_gates:
            vectors["truth.gate_shifts"] = 2 * len(self._track.gates)
        model = Value[object]()
        self._ports = {
            **{name: self.DeclareVectorInputPort(name, n) for name, n in vectors.items()},
            **{name: self.DeclareAbstractInputPort(name, model) for name in values},
        }

    def close(self) -> None:
        """Ends the file.

        Raises:
            UserError: if it cannot be written.
        """
        self._log.close()

    def _value(self, context, name):
        """Returns the value of a port; None if it has none."""
        port = self._ports.get(name)
        return None if port is None or not port.HasValue(context) else port.Eval(context)

    def _changed(self, context, name):
        """Returns the value of a port if it is another object than at the last call, else None."""
        value = self._value(context, name)
        if value is None or value is self._written.get(name):
            return None
        self._written[name] = value
        return value

    def _write_states(self, context):
        time = context.get_time()
        for name, (_, port, encode) in SAMPLED.items():
            value = self._value(context, port)
            if value is not None:
                self._log.write(name, time, encode(time, value, self._vehicle))

    def _error(self, context):
        """Returns the error of the filtered estimate, see estimate_error(); NaN if not known."""
        truth, estimate = (self._value(context, p) for p in ("truth.state", "filtered_estimate"))
        if truth is None or estimate is None:
            return np.full(9, np.nan)
        return json_topics.estimate_error(as_plant_state(truth), as_state(estimate))

    def _write_samples(self, context):
        vector = self._value(context, "imu")
        if vector is not None:
            data, self._newest_sample = json_topics.imu_samples_data(vector, self._newest_sample)
            if data is not None:
                self._log.write("/imu/samples", context.get_time(), data)

    def _write_poses(self, context):
        state, info = self._value(context, "truth.state"), self._value(context, "camera_info")
        if state is not None and info is not None:
            pose = as_plant_state(state)._replace(time=context.get_time())
            self._log.write("/tf", pose.time, messages.transforms(pose, info.X_BC))

    def _extend_path(self, context):
        state = self._value(context, "truth.state")
        if state is not None:
            now = as_plant_state(state)
            point = now.position.tolist(), np.linalg.norm(now.velocity)
            self._path = [*self._path[1 - _PATH_POINTS :], point]

    def _write_path(self, context):
        if self._path:
            time, (positions, speeds) = context.get_time(), zip(*self._path)
            scene = scene_updates.path_scene(time, positions, speeds, self._max_speed)
            self._log.write("/path", time, scene)

    def _write_changes(self, context):
        time, write = context.get_time(), self._log.write
        self._write_track(context, time)
        detections = self._changed(context, "detections")
        if detections is not None and detections.time >= 0.0:
            write("/detections", time, json_topics.detections_data(detections))
            write("/detections/rays", time, scene_updates.detection_rays(detections))
        plan = self._changed(context, "lap_plan")
        if plan is not None and plan is not NO_PLAN:
            self._plans = [*self._plans[-_OLD_PLANS:], plan]
            write("/plan", time, json_topics.plan_data(plan))
            write("/plan/scene", time, scene_updates.plan_scene(time, self._plans))
        explorer = self._changed(context, "explorer_status")
        if explorer is not None:
            self._write_explorer(time, explorer)
        slam = self._changed(context, "slam_state")
        if slam is not None and slam.time > self._estimated:
            self._estimated = slam.time
            write("/estimator", time, json_topics.estimator_data(slam, self._error(context)))
        referee = self._changed(context, "truth.referee_status")
        lap_ends = referee is not None and self._write_referee(time, referee)
        if lap_ends or time >= self._map_time + _MAP_PERIOD:
            gate_map = self._changed(context, "gate_map")
            if gate_map is not None:
                self._map_time = time
                write("/map", time, json_topics.full_map_data(gate_map))
                write("/map/scene", time, scene_updates.map_scene(time, gate_map))

    def _write_track(self, context, time):
        shifts = self._value(context, "truth.gate_shifts")
        shifts = None if shifts is None else shifts.tolist()
        if "track" not in self._written or shifts != self._written["track"]:
            self._written["track"] = shifts
            track = self._track
            if shifts is not None:
                track = track.shifted(shifts)
            self._log.write("/scene", time, scene_updates.track_scene(time, track, self._vehicle))

    def _write_explorer(self, time, status):
        for event in status.events[self._events :]:
            message = messages.log(event.time, event.state, event.reason)
            self._log.write("/explorer", time, message)
        if not status.events and (status.state, status.since) != self._start:
            # An explorer of one's own may keep no events.
            self._start = status.state, status.since
            message = messages.log(status.since, status.state, status.reason)
            self._log.write("/explorer", time, message)
        self._events = len(status.events)

    def _write_referee(self, time: float, status: "RefereeStatus") -> bool:
        """Writes what the referee says; returns whether a lap has ended."""
        new = status.crossings[self._crossings :]
        self._crossings = len(status.crossings)
        for crossing in new:
            message = messages.log(
                crossing.time,
                "gate",
                f"gate {crossing.gate} of lap {crossing.lap}, {crossing.offset:.2f} m from its "
                f"midpoint, at most {crossing.max_speed:.1f} m/s since the one before",
            )
            self._log.write("/referee", time, message)
            self._log.write("/referee/crossings", time, json_topics.crossing_data(crossing))
        if status.end_time is not None:
            reason = status.dnf_reason or "finished"
            message = messages.log(status.end_time, "over", reason, bad=not status.finished)
            self._log.write("/referee", time, message)
        return any(crossing.gate == 1 for crossing in new)

    def _write_image(self, context):
        view, info = self._value(context, "camera_view"), self._value(context, "camera_info")
        if view is None or info is None:
            return
        time, write = context.get_time(), self._log.write
        (image_time,) = self._value(context, "camera_image_time")
        scale = min(1.0, self._config.image_width / info.width)
        jpeg = messages.jpeg(view.whole(), scale, self._config.jpeg_quality)
        write("/camera/image", time, messages.image(image_time, jpeg))
        write("/camera/calibration", time, messages.calibration(image_time, info, scale))
        detections = self._value(context, "detections")
        if detections is not None and detections.time == image_time:
            write("/camera/annotations", time, messages.annotations(detections, info, scale))


def AddRecorder(
    builder: DiagramBuilder,
    scenario: Scenario,
    simulation: Diagram,
    autonomy: Diagram,
    output_dir: Path,
    live: "FoxgloveServer | None" = None,
) -> RaceRecorder | None:
    """Adds what writes race.mcap, unless the scenario wants none, and serves the same live.

    Args:
        builder: of the race.
        scenario: the race.
        simulation, autonomy: the two diagrams in it.
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
    moving_gates = simulation.HasOutputPort("truth.gate_shifts")
    recorder = RaceRecorder(scenario=scenario, log=log, moving_gates=moving_gates)
    builder.AddNamedSystem(_NAME, recorder)
    for i in range(recorder.num_input_ports()):
        port = recorder.get_input_port(i)
        for source in (simulation, autonomy):
            if source.HasOutputPort(port.get_name()):
                builder.Connect(source.GetOutputPort(port.get_name()), port)
                break
    return recorder


def close_recording(race: Diagram) -> None:
    """Ends the file that the recorder of a race writes, if it has one.

    Raises:
        UserError: if it cannot be written.
    """
    if race.HasSubsystemNamed(_NAME):
        race.GetSubsystemByName(_NAME).close()
