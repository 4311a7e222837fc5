"""Tells the page of a race what happens in it."""

from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RotationMatrix

from airrace.recording.foxglove_messages import jpeg, raw_pixels
from airrace.recording.json_topics import estimate_error
from airrace.rendering.imaging.motion_blur import pose_of
from airrace.systems.estimation.error_state import AT
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.types import Detections
from airrace.vehicle import GRAVITY
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.state import STATE_SIZE, as_plant_state, as_state
from airrace.visualization.meshcat_page import Audience
from airrace.visualization.race_record import (
    CROSSINGS,
    ESTIMATES,
    EVENTS,
    MAPS,
    PLANS,
    SHIFTS,
    STATUS,
    RaceRecord,
    encoded,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pydrake.math import RigidTransform

    from airrace.systems.planning.lap_plan import LapPlan
    from airrace.track import Course
    from airrace.vehicle import Vehicle

_FRAME_PERIOD, _NEWS_PERIOD = 1 / 30, 0.1  # s
_MAP_PERIOD = 1.0  # s
# s, between two pictures for who watches, and between two that a replay shows. At these times
# the race's log has the whole picture drawn, too, unless it is told to do so less often.
_PICTURE_PERIOD, KEPT_PERIOD = 0.2, 0.4
WIDTH, QUALITY = 320, 60  # px and JPEG's, of pictures
# Radii of a marker's ellipsoid in standard deviations, which are millimetres; but the least
# is seen.
MAGNIFICATION = 100.0
_LEAST_RADIUS = 0.15  # m
_CHANGE = 0.02  # m, of place or radius, that is told
_SIGMAS = 3.0  # of the ellipsoid of the drone's own position, in true size
_PLAN_STEP = 0.08  # s, between two points of a plan


class RaceFeed(LeafSystem):
    """Writes what a page shows of a race to a RaceRecord.

    .. pydrake_system::

        name: RaceFeed
        input_ports:
        - truth.state
        - filtered_estimate
        - rotor_speeds
        - gate_map
        - lap_plan
        - explorer_status
        - truth.referee_status
        - detections
        - camera_view (only if there is a camera)
        - camera_image_time (only if there is a camera)
        - camera_info (only if there is a camera)
        - truth.gate_shifts (only if gates move)
        - slam_state (only with vio)

    All are as the systems that they come from describe them; what is not connected is not
    shown. Pictures are kept for the replay if the race's log keeps them too, which has them
    drawn anyway; while somebody watches there are more.
    """

    def __init__(
        self,
        *,
        record: RaceRecord,
        track: "Course",
        vehicle: "Vehicle",
        audience: Audience,
        camera: bool,
        keep_pictures: bool,
        moving_gates: bool = False,
        estimates: bool = False,
    ):
        """Constructs the feed.

        Args:
            record: to write to.
            track, vehicle: of the race.
            audience: of the page.
            camera: whether there is one.
            keep_pictures: whether pictures are kept for the replay.
            moving_gates: whether there is a port ``truth.gate_shifts``.
            estimates: whether there is a port ``slam_state``.
        """
        LeafSystem.__init__(self)
        self._record, self._track, self._vehicle = record, track, vehicle
        self._audience, self._keep = audience, keep_pictures
        self._weight = vehicle.mass * GRAVITY
        self._declare_ports(camera, moving_gates, estimates)
        # What was told last. It is output, not state: nothing in the race depends on it.
        self._known: dict[str, object] = {}
        self._map = MapNews()
        self._events = self._crossings = 0
        self._plan, self._next_kept, self._next_map = NO_PLAN, 0.0, 0.0
        self.DeclarePeriodicPublishEvent(_FRAME_PERIOD, 0.0, self._add_frame)
        self.DeclarePeriodicPublishEvent(_NEWS_PERIOD, 0.0, self._add_news)
        if camera:
            self.DeclarePeriodicPublishEvent(_PICTURE_PERIOD, 0.0, self._add_picture)
        self.DeclareForcedPublishEvent(self._add_last)

    def _declare_ports(self, camera, moving_gates, estimates):
        n = len(self._vehicle.rotors)
        vectors = {
            "truth.state": STATE_SIZE - 1,
            "filtered_estimate": STATE_SIZE,
            "rotor_speeds": n,
            **({"camera_image_time": 1} if camera else {}),
            **({"truth.gate_shifts": 2 * len(self._track.gates)} if moving_gates else {}),
        }
        values = ["gate_map", "lap_plan", "explorer_status", "truth.referee_status", "detections"]
        values += ["camera_view", "camera_info"] if camera else []
        values += ["slam_state"] if estimates else []
        model = Value[object]()
        self._ports = {
            **{name: self.DeclareVectorInputPort(name, n) for name, n in vectors.items()},
            **{name: self.DeclareAbstractInputPort(name, model) for name in values},
        }

    def _value(self, context, name):
        """Returns the value of a port; None if it has none."""
        port = self._ports.get(name)
        return None if port is None or not port.HasValue(context) else port.Eval(context)

    def _changed(self, context, name):
        """Returns the value of a port if it is another object than at the last call, else None."""
        value = self._value(context, name)
        if value is None or value is self._known.get(name):
            return None
        self._known[name] = value
        return value

    def _add_frame(self, context):
        state = as_plant_state(self._value(context, "truth.state"))
        speeds = self._value(context, "rotor_speeds")
        estimate = self._value(context, "filtered_estimate")
        error = thrust = 0.0
        if speeds is not None:
            thrust = float(self._vehicle.thrust_coefficients @ np.square(speeds)) / self._weight
        if estimate is not None and estimate.any():  # nothing before the first
            error = float(np.linalg.norm(as_state(estimate).position - state.position))
        speed = float(np.linalg.norm(state.velocity))
        self._record.add_frame(
            (context.get_time(), *state.position, *state.quaternion, speed, thrust, error)
        )

    def _add_last(self, context):
        self._add_frame(context)
        self._add_news(context)

    def _add_news(self, context):
        time = context.get_time()
        self._add_plan(context, time)
        self._add_status(context, time)
        self._add_referee(context)
        self._add_estimate(context, time)
        shifts = self._value(context, "truth.gate_shifts")
        if shifts is not None and not np.array_equal(shifts, self._known.get(SHIFTS)):
            self._known[SHIFTS] = shifts.copy()
            gates = self._track.shifted(shifts).gates
            self._record.add(SHIFTS, time, gates=[g.p_WG[:2].round(2).tolist() for g in gates])
        if time >= self._next_map:
            gate_map = self._changed(context, "gate_map")
            if gate_map is not None and gate_map.markers:
                self._next_map = time + _MAP_PERIOD
                markers = [(m.id, m.p_WM, m.variance) for m in gate_map.markers]
                self._record.add(MAPS, time, **self._map.of(markers))

    def _add_estimate(self, context, time):
        names = ("truth.state", "filtered_estimate", "slam_state")
        truth, estimate, slam = (self._value(context, name) for name in names)
        if truth is None or estimate is None or slam is None or slam.time < 0.0:
            return
        error = estimate_error(as_plant_state(truth), as_state(estimate))
        covariance = slam.belief.covariance[AT.position, AT.position]
        if np.isfinite(error).all() and np.isfinite(covariance).all():
            self._record.add(ESTIMATES, time, **estimate_data(error, covariance))

    def _add_plan(self, context, time):
        plan = self._value(context, "lap_plan")
        # Over a link, the same plan comes again and again, as another object.
        if plan is None or (plan.lap, plan.start_time) == (self._plan.lap, self._plan.start_time):
            return
        self._plan = plan
        self._record.add(PLANS, time, lap=plan.lap, points=encoded(plan_points(plan)))
        text = f"plan for lap {plan.lap}: {plan.circuit.duration:.2f} s"
        self._record.add(EVENTS, time, text=text)

    def _add_status(self, context, time):
        status = self._value(context, "explorer_status")
        if status is None:
            return
        now = status.state, len(status.gates), status.done, self._plan is not NO_PLAN
        if now != self._known.get(STATUS):
            self._known[STATUS] = now
            names = ("state", "gates", "done", "racing")
            self._record.add(STATUS, time, **dict(zip(names, now)))
        for event in status.events[self._events :]:
            self._record.add(EVENTS, event.time, text=event_text(event.state, event.reason))
        self._events = len(status.events)

    def _add_referee(self, context):
        report = self._value(context, "truth.referee_status")
        if report is None:
            return
        for each in report.crossings[self._crossings :]:
            self._record.add(CROSSINGS, each.time, gate=each.gate, lap=each.lap)
            self._record.add(EVENTS, each.time, text=crossing_text(each.gate, each.offset))
        self._crossings = len(report.crossings)

    def _add_picture(self, context):
        time, info = context.get_time(), self._value(context, "camera_info")
        kept = self._keep and time >= self._next_kept
        if info is None or not (self._audience.waits() or kept):
            return
        if kept:
            self._next_kept = time + KEPT_PERIOD - 1e-6
        (taken,) = self._value(context, "camera_image_time")
        if taken < 0.0 or taken == self._known.get("picture"):
            return
        self._known["picture"] = taken
        detections, markers = self._value(context, "detections"), []
        # A detector that takes its time answers when there is another picture already.
        if detections is not None and detections.time == taken:
            state = as_plant_state(self._value(context, "truth.state"))
            X_WC = pose_of(state, taken - time) @ info.X_BC
            markers = marker_data(detections, info, X_WC)
        picture = self._value(context, "camera_view").whole()
        scale = min(1.0, WIDTH / info.width)
        self._record.add_picture(taken, jpeg(picture, scale, QUALITY), markers)


class MapNews:
    """What has changed to the eye in a map, since it was told last."""

    def __init__(self) -> None:
        """Begins with an empty map."""
        self._told: dict[int, np.ndarray] = {}  # marker ID to place and radii, (6,)

    def of(self, markers: "Iterable[tuple[int, np.ndarray, np.ndarray]]") -> dict:
        """Returns what RaceRecord.add() takes for MAPS.

        Args:
            markers: of the map: ID, p_WM (m), (3,), and variances (m^2), (3,).
        """
        changed, worst = [], 0.0
        for marker, p_WM, variance in markers:
            sigmas = np.sqrt(variance)
            worst = max(worst, float(sigmas.max()))
            radii = np.maximum(MAGNIFICATION * sigmas, _LEAST_RADIUS)
            ellipsoid = np.concatenate([p_WM, radii])
            told = self._told.get(marker)
            if told is None or np.abs(ellipsoid - told).max() > _CHANGE:
                self._told[marker] = ellipsoid
                changed.append([marker, *ellipsoid.round(2).tolist()])
        return {"sigma": round(worst, 4), "changed": changed}


def estimate_data(error: np.ndarray, covariance: np.ndarray) -> dict:
    """Returns what RaceRecord.add() takes for ESTIMATES.

    Args:
        error: of the estimate, see estimate_error(), at least its first six numbers.
        covariance: of the position (m^2), (3, 3).

    Returns:
        ``offset`` of the estimated drone from the true one (m), its ``turn``, a rotation vector in
        axes of the body (rad), ``radii`` of the ellipsoid of three standard deviations (m), its
        ``axes``, a quaternion x, y, z, w, and the greatest standard deviation, ``sigma`` (m).
    """
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    w, x, y, z = RotationMatrix.ProjectToRotationMatrix(axes).ToQuaternion().wxyz()
    return {
        "offset": (-error[3:6]).round(4).tolist(),
        "turn": (-error[:3]).round(5).tolist(),
        "radii": (_SIGMAS * sigmas).round(4).tolist(),
        "axes": [round(float(each), 4) for each in (x, y, z, w)],
        "sigma": round(float(sigmas[-1]), 4),
    }


def event_text(state: str, reason: str) -> str:
    """Returns a change of the explorer's state in words."""
    return f"{state.replace('_', ' ').lower()}: {reason}"


def crossing_text(gate: int, offset: float) -> str:
    """Returns a crossing in words; gate: its number. offset: from its middle (m)."""
    return f"gate {gate}, {offset:.2f} m from its middle"


def marker_data(detections: Detections, info: CameraInfo, X_WC: "RigidTransform") -> list[dict]:
    """Returns the markers of a picture as RaceRecord.add_picture() takes them.

    Args:
        detections: in it.
        info: of the camera.
        X_WC: pose of the camera.
    """
    size = np.array([info.width, info.height])
    data = []
    for marker in detections.markers:
        # Integers are pixel centres.
        corners = (raw_pixels(marker.corners, info) + 0.5) / size
        p_WM = X_WC @ marker.X_CM.translation()
        data.append(
            {
                "id": marker.id,
                "corners": corners.round(4).ravel().tolist(),
                "p": p_WM.round(2).tolist(),
            }
        )
    return data


def plan_points(plan: "LapPlan") -> np.ndarray:
    """Returns points along the entry and the circuit of a plan, (n, 3) m."""
    parts = []
    for part in (plan.entry, plan.circuit):
        assert part is not None  # of NO_PLAN only
        count = max(2, round(part.duration / _PLAN_STEP))
        parts.append(part.positions(np.linspace(0.0, part.duration, count)).T)
    return np.vstack(parts)
