"""Writes race.mcap as the race goes on."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.recording import foxglove_messages, json_topics, scene_updates
from airrace.recording.writer import RaceLog
from airrace.scenario.recording import RecordingConfig
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.referee_status import RefereeStatus
from airrace.systems.types import Detections, ExplorerStatus
from airrace.track import Track
from airrace.track.gate_map import GateMap
from airrace.trajopt.reference import REFERENCE_SIZE, as_reference
from airrace.vehicle import Vehicle
from airrace.vehicle.state import STATE_SIZE, as_state

_MAP_PERIOD = 1.0  # s between two writes of a map that changed
_PATH_PERIOD, _PATH_POINTS = 1.0, 150  # s; how many of the last looks a path shows
_LOOKS = 10.0  # Hz, at the way flown
# Periods that a picture may come after the last. At 5 Hz these are ten pictures of the camera:
# the detector looks at all of one every five or eight.
_PATIENCE = 5 / 3
_OLD_PLANS = 3  # shown beside the one in force


class RaceRecorder(LeafSystem):
    """Writes what crosses a race's ports to a log; topics.py says where to.

    .. pydrake_system::

        name: RaceRecorder
        input_ports:
        - truth.state
        - state_estimate
        - filtered_estimate
        - disturbance
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

    All are as the systems that they come from describe them. What is not connected
    is not recorded. States are written at their rate, everything else when it is
    new, within a period of the camera. Pictures that the detector has looked at as a
    whole are preferred, so that they may be up to two thirds farther apart than their
    rate says; each comes with outlines of the markers found in it. Nothing in the race
    depends on it: it only publishes, and what it remembers is what the file holds already.
    """

    def __init__(
        self,
        *,
        log: RaceLog,
        config: RecordingConfig,
        track: Track,
        vehicle: Vehicle,
        fps: float,
        max_speed: float,
        moving_gates: bool = False,
    ):
        """Constructs the recorder.

        Args:
            log: to write to; Close() closes it.
            config: a RecordingConfig whose content is not "none".
            track: where the gates stand.
            vehicle: the drone, as its file says.
            fps: of the camera, and how often it looks for what is new (Hz).
            max_speed: shown red (m/s).
            moving_gates: whether there is a port ``truth.gate_shifts``.
        """
        LeafSystem.__init__(self)
        self._log, self._config = log, config
        self._track, self._vehicle, self._max_speed = track, vehicle, max_speed
        self._c_f = vehicle.thrust_coefficients.tolist()
        n = len(vehicle.rotors)
        pictures = config.content == "full"
        sizes = {
            "truth.state": STATE_SIZE - 1,
            "state_estimate": STATE_SIZE,
            "filtered_estimate": STATE_SIZE,
            "disturbance": 3,
            "reference": REFERENCE_SIZE,
            "rotor_speeds": n,
            "rotor_speed_command": n,
        }
        if moving_gates:
            sizes["truth.gate_shifts"] = 2 * len(track.gates)
        values = {
            "camera_info": None,
            "detections": Detections(),
            "gate_map": GateMap(),
            "lap_plan": NO_PLAN,
            "explorer_status": ExplorerStatus(),
            "truth.referee_status": RefereeStatus((), False, None, None, 0),
        }
        if pictures:
            values["camera_view"] = None
            sizes["camera_image_time"] = 1
        self._ports = {
            name: self.DeclareVectorInputPort(name, size) for name, size in sizes.items()
        }
        self._ports |= {
            name: self.DeclareAbstractInputPort(name, _model(value))
            for name, value in values.items()
        }
        # Of what was written last. It is output, not state: see the class.
        self._written, self._map_time, self._image_time = {}, -np.inf, -np.inf
        self._path, self._plans = [], []
        self._start, self._events, self._crossings = None, 0, 0
        self.DeclarePeriodicPublishEvent(1 / config.state_rate, 0.0, self._write_states)
        self.DeclarePeriodicPublishEvent(1 / fps, 0.0, self._write_news)
        self.DeclarePeriodicPublishEvent(1 / config.pose_rate, 0.0, self._write_poses)
        self.DeclarePeriodicPublishEvent(1 / _LOOKS, 0.0, self._write_path)
        if pictures:
            self.DeclarePeriodicPublishEvent(1 / fps, 0.0, self._write_image)
        self.DeclarePeriodicPublishEvent(
            config.flush_period, 0.0, lambda context: self._log.flush()
        )

    def close(self) -> None:
        """Ends the file.

        Raises:
            UserError: if it cannot be written.
        """
        self._log.close()

    def _value(self, context, name):
        """Returns the value of a port, a vector's as a list; None if it has none."""
        port = self._ports.get(name)
        if port is None or not port.HasValue(context):
            return None
        value = port.Eval(context)
        return value.tolist() if isinstance(value, np.ndarray) else value

    def _new(self, context, name):
        """Returns the value of a port if it is another than at the last call, else None."""
        value = self._value(context, name)
        if value is None or value is self._written.get(name):
            return None
        self._written[name] = value
        return value

    def _write_states(self, context):
        time, write = context.get_time(), self._log.write
        state = self._value(context, "truth.state")
        if state is not None:
            write("/state/truth", time, foxglove_messages.odometry(time, state))
        for name, topic in (("state_estimate", "estimate"), ("filtered_estimate", "filtered")):
            estimate = self._value(context, name)
            if estimate is not None:
                message = foxglove_messages.odometry(as_state(estimate).time, estimate[1:])
                write(f"/state/{topic}", time, message)
        reference = self._value(context, "reference")
        if reference is not None:
            write("/reference", time, foxglove_messages.reference_odometry(time, reference))
            write(
                "/reference/acceleration",
                time,
                foxglove_messages.vector3(as_reference(reference).acceleration),
            )
        disturbance = self._value(context, "disturbance")
        if disturbance is not None:
            write("/state/disturbance", time, foxglove_messages.vector3(disturbance))
        for name, topic in (("rotor_speeds", "measured"), ("rotor_speed_command", "command")):
            speeds = self._value(context, name)
            if speeds is not None:
                write(f"/rotors/{topic}", time, foxglove_messages.rotors(time, speeds, self._c_f))

    def _write_poses(self, context):
        state, info = self._value(context, "truth.state"), self._value(context, "camera_info")
        if state is not None and info is not None:
            time = context.get_time()
            self._log.write("/tf", time, foxglove_messages.transforms(time, state, info.X_BC))

    def _write_path(self, context):
        state, time = self._value(context, "truth.state"), context.get_time()
        if state is None:
            return
        self._path = [*self._path[1 - _PATH_POINTS :], (state[4:7], np.linalg.norm(state[10:13]))]
        if round(time * _LOOKS) % round(_PATH_PERIOD * _LOOKS) == 0:
            self._log.write(
                "/path", time, scene_updates.path_scene(time, *zip(*self._path), self._max_speed)
            )

    def _write_news(self, context):
        time, write = context.get_time(), self._log.write
        self._write_track(context, time)
        detections = self._new(context, "detections")
        if detections is not None and detections.time >= 0.0:
            write("/detections", time, json_topics.detections_data(detections))
            write("/detections/rays", time, scene_updates.detection_rays(detections))
        plan = self._new(context, "lap_plan")
        if plan is not None and plan is not NO_PLAN:
            self._plans = [*self._plans[-_OLD_PLANS:], plan]
            write("/plan", time, json_topics.plan_data(plan))
            write("/plan/scene", time, scene_updates.plan_scene(time, self._plans))
        status = self._new(context, "explorer_status")
        if status is not None:
            self._write_events(time, status)
        report = self._new(context, "truth.referee_status")
        laps_end = report is not None and self._write_report(time, report)
        if laps_end or time >= self._map_time + _MAP_PERIOD:
            gate_map = self._new(context, "gate_map")
            if gate_map is not None:
                self._map_time = time
                write("/map", time, json_topics.full_map_data(gate_map))
                write("/map/scene", time, scene_updates.map_scene(time, gate_map))

    def _write_track(self, context, time):
        shifts = self._value(context, "truth.gate_shifts")
        if "track" not in self._written or shifts != self._written["track"]:
            self._written["track"] = shifts
            track = self._track if shifts is None else self._track.shifted(shifts)
            self._log.write("/scene", time, scene_updates.track_scene(time, track, self._vehicle))

    def _write_events(self, time, status):
        for event in status.events[self._events :]:
            message = foxglove_messages.log(event.time, event.state, event.reason)
            self._log.write("/explorer", time, message)
        if not status.events and (status.state, status.since) != self._start:
            # An explorer of one's own may keep no events.
            self._start = status.state, status.since
            message = foxglove_messages.log(status.since, status.state, status.reason)
            self._log.write("/explorer", time, message)
        self._events = len(status.events)

    def _write_report(self, time, report) -> bool:
        """Writes what the referee saw; returns whether that ended a lap."""
        new = report.crossings[self._crossings :]
        self._crossings = len(report.crossings)
        for crossing in new:
            message = foxglove_messages.log(
                crossing.time,
                "gate",
                f"gate {crossing.gate} of lap {crossing.lap}, {crossing.offset:.2f} m from its "
                f"midpoint, at most {crossing.max_speed:.1f} m/s since the one before",
            )
            self._log.write("/referee", time, message)
            self._log.write("/referee/crossings", time, json_topics.crossing_data(crossing))
        if report.over:
            message = foxglove_messages.log(
                report.end_time,
                "over",
                "finished" if report.finished else report.dnf_reason,
                bad=not report.finished,
            )
            self._log.write("/referee", time, message)
        return any(crossing.gate == 1 for crossing in new)

    def _write_image(self, context):
        # A whole picture is several times the work of the parts that the detector mostly
        # looks at. It is worth waiting a little for one that it has looked at as a whole.
        time = context.get_time()
        periods = (time - self._image_time) * self._config.image_rate + 1e-6
        if periods < 1.0:
            return
        view, info = self._value(context, "camera_view"), self._value(context, "camera_info")
        if view is None or info is None or (periods < _PATIENCE and not view.is_complete):
            return
        self._image_time = time
        scale = min(1.0, self._config.image_width / info.width)
        jpeg = foxglove_messages.jpeg(view.whole(), scale, self._config.jpeg_quality)
        (image_time,) = self._value(context, "camera_image_time")
        write = self._log.write
        write("/camera/image", time, foxglove_messages.image(image_time, jpeg))
        write("/camera/calibration", time, foxglove_messages.calibration(image_time, info, scale))
        detections = self._value(context, "detections")
        if detections is not None and detections.time == image_time:
            write(
                "/camera/annotations", time, foxglove_messages.annotations(detections, info, scale)
            )


def _model(value):
    return Value[object]() if value is None else Value[object](value)
