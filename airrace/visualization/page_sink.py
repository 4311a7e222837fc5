"""What the page of a race shows, made of the race's events: live, and again from its log."""

import functools
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RotationMatrix

from airrace.recording import race_events as events
from airrace.recording.foxglove_messages import jpeg, raw_pixels
from airrace.recording.json_topics import packed
from airrace.rendering.imaging.motion_blur import pose_of
from airrace.systems.estimation.error_state import AT
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.types import Detection, Detections, ExplorerStatus
from airrace.trajopt.body_frames import body_frames
from airrace.vehicle import GRAVITY, Vehicle
from airrace.vehicle.state import State
from airrace.visualization.arrows import frame_arrows
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
)

if TYPE_CHECKING:
    from airrace.track import Course

# s, the least between two frames, two estimates, and two pictures that a replay shows.
_FRAME_PERIOD, _ESTIMATE_PERIOD, _PICTURE_PERIOD = 1 / 30, 0.1, 0.4
_EARLY = 1e-6  # s, by which a clock that was added up may be late
WIDTH, QUALITY = 320, 60  # px and JPEG's, of pictures
# Radii of a marker's ellipsoid in standard deviations, which are millimetres; but the least
# is seen.
MAGNIFICATION = 100.0
_LEAST_RADIUS = 0.15  # m
_CHANGE = 0.02  # m, of place or radius, that is seen
_SIGMAS = 3.0  # of the ellipsoid of the drone's own position, in true size
_PLAN_STEP = 0.08  # s, between two points of a plan
_ARROW_STEP = 0.02  # s, between two samples that body frames are chosen from


class PageSink:
    """A sink that adds to a RaceRecord, and draws the attitude of planned laps in a Meshcat.

    Arrows along the body's x and z axis of a plan are at ``plans/lap_<the first lap flown on it>``.
    The page shows those of the plan in force, and draws the lines of all plans itself.
    """

    def __init__(
        self,
        record: RaceRecord,
        track: "Course",
        vehicle: Vehicle,
        *,
        meshcat: Meshcat | None = None,
        audience: Audience | None = None,
        keep_pictures: bool = True,
    ):
        """Constructs the sink.

        Args:
            record: to add to.
            track, vehicle: of the race.
            meshcat: to draw in; None: nothing is drawn.
            audience: for whom there are more pictures, if somebody watches.
            keep_pictures: whether pictures are kept for a replay, which has them drawn.
        """
        self._record, self._track, self._vehicle = record, track, vehicle
        self._meshcat, self._audience, self._keep = meshcat, audience, keep_pictures
        self._weight = vehicle.mass * GRAVITY
        self._next_frame = self._next_estimate = self._next_picture = 0.0
        self._truth: State | None = None
        self._detections, self._taken = Detections(), -1.0
        self._status, self._racing = ExplorerStatus(), False
        self._told_delay = 0.0  # s, of plans
        self._shown_status = dict[str, object]()
        self._ellipsoids: dict[int, np.ndarray] = {}  # marker ID to place and radii, (6,)

    @functools.singledispatchmethod
    def take(self, event: events.RaceEvent) -> None:
        """Adds an event to the page; of most kinds there is a method below."""

    @take.register
    def _(self, event: events.StateSample) -> None:
        self._truth = truth = event.truth
        if event.time < self._next_frame:
            return
        self._next_frame = event.time + _FRAME_PERIOD - _EARLY
        error = thrust = 0.0
        if event.rotor_speeds is not None:
            thrusts = self._vehicle.thrust_coefficients @ np.square(event.rotor_speeds)
            thrust = float(thrusts) / self._weight
        if event.filtered is not None and event.filtered.quaternion.any():  # none before the first
            error = float(np.linalg.norm(event.filtered.position - truth.position))
        speed = float(np.linalg.norm(truth.velocity))
        frame = (event.time, *truth.position, *truth.quaternion, speed, thrust, error)
        self._record.add_frame(frame)

    @take.register
    def _(self, event: events.ExplorerChanged) -> None:
        self._status = event.status
        self._show_status(event.time)
        for each in event.entered:
            text = f"{each.state.replace('_', ' ').lower()}: {each.reason}"
            self._record.add(EVENTS, each.time, text=text)

    @take.register
    def _(self, event: events.PlanMade) -> None:
        plan, self._racing = event.plan, True
        assert plan.circuit is not None
        self._record.add(PLANS, event.time, lap=plan.lap, points=packed(plan_points(plan), "<f4"))
        text = f"plan for lap {plan.lap}: {plan.circuit.duration:.2f} s"
        self._record.add(EVENTS, event.time, text=text)
        self._show_status(event.time)
        if self._meshcat is not None:
            count = max(2, round(plan.circuit.duration / _ARROW_STEP))
            samples = plan.circuit.sample(np.linspace(0.0, plan.circuit.duration, count))
            arrows = frame_arrows(body_frames(samples))
            self._meshcat.SetTriangleColorMesh(f"plans/lap_{plan.lap}", *arrows)

    @take.register
    def _(self, event: events.ClockWaits) -> None:
        if not event.goes_on:
            waited, self._told_delay = event.delay - self._told_delay, event.delay
            self._record.add(EVENTS, event.time, text=f"the clock waited {waited:.2f} s here")

    def _show_status(self, time: float) -> None:
        status = self._status
        now = status.state, len(status.gates), status.done, self._racing
        values = dict(zip(("state", "gates", "done", "racing"), now))
        if values != self._shown_status:
            self._shown_status = values
            self._record.add(STATUS, time, **values)

    @take.register
    def _(self, event: events.GateCrossed) -> None:
        crossing = event.crossing
        self._record.add(CROSSINGS, crossing.time, gate=crossing.gate, lap=crossing.lap)
        text = f"gate {crossing.gate}: {crossing.offset:.2f} m off its middle"
        self._record.add(EVENTS, crossing.time, text=text)

    @take.register
    def _(self, event: events.GatesMoved) -> None:
        gates = self._track.shifted(event.shifts).gates
        places = [gate.p_WG[:2].round(2).tolist() for gate in gates]
        self._record.add(SHIFTS, event.time, gates=places)

    @take.register
    def _(self, event: events.MapChanged) -> None:
        changed, worst = [], 0.0
        for marker in event.gate_map.markers:
            sigmas = np.sqrt(marker.variance)
            worst = max(worst, float(sigmas.max()))
            radii = np.maximum(MAGNIFICATION * sigmas, _LEAST_RADIUS)
            ellipsoid = np.concatenate([marker.p_WM, radii])
            shown = self._ellipsoids.get(marker.id)
            if shown is None or np.abs(ellipsoid - shown).max() > _CHANGE:
                self._ellipsoids[marker.id] = ellipsoid
                changed.append([marker.id, *ellipsoid.round(2).tolist()])
        if event.gate_map.markers:
            self._record.add(MAPS, event.time, sigma=round(worst, 4), changed=changed)

    @take.register
    def _(self, event: events.EstimateMade) -> None:
        covariance = event.covariance[AT.position, AT.position]
        finite = np.isfinite(event.error).all() and np.isfinite(covariance).all()
        if finite and event.time >= self._next_estimate:
            self._next_estimate = event.time + _ESTIMATE_PERIOD - _EARLY
            self._record.add(ESTIMATES, event.time, **estimate_data(event.error, covariance))

    @take.register
    def _(self, event: events.DetectionsSeen) -> None:
        self._detections = event.detections

    @take.register
    def _(self, event: events.Picture) -> None:
        kept = self._keep and event.time >= self._next_picture
        if not (kept or (self._audience is not None and self._audience.waits())):
            return
        if kept:
            self._next_picture = event.time + _PICTURE_PERIOD - _EARLY
        if event.taken < 0.0 or event.taken == self._taken:
            return
        self._taken = event.taken
        small = jpeg(event.view.whole(), min(1.0, WIDTH / event.view.shape[1]), QUALITY)
        self._record.add_picture(event.taken, small, self._markers_of(event))

    def _markers_of(self, picture: events.Picture) -> list[dict]:
        """Returns the markers of a picture as RaceRecord.add_picture() takes them."""
        # A detector that takes its time answers when there is another picture already.
        if self._truth is None or abs(self._detections.time - picture.taken) > _EARLY:
            return []
        X_WB = pose_of(self._truth, picture.taken - self._truth.time)
        X_WC, info = X_WB @ picture.info.X_BC, picture.info
        size = np.array([info.width, info.height])

        def data(marker: Detection) -> dict:
            # Integers are pixel centres.
            corners = (raw_pixels(marker.corners, info) + 0.5) / size
            p_WM = X_WC @ marker.X_CM.translation()
            places = {"corners": corners.round(4).ravel().tolist(), "p": p_WM.round(2).tolist()}
            return {"id": marker.id, **places}

        return [data(marker) for marker in self._detections.markers]


def estimate_data(error: np.ndarray, covariance: np.ndarray) -> dict:
    """Returns what RaceRecord.add() takes for ESTIMATES.

    Args:
        error: of the estimate, see estimate_error().
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
        "offset": (-error[AT.position]).round(4).tolist(),
        "turn": (-error[AT.theta]).round(5).tolist(),
        "radii": (_SIGMAS * sigmas).round(4).tolist(),
        "axes": [round(float(each), 4) for each in (x, y, z, w)],
        "sigma": round(float(sigmas[-1]), 4),
    }


def plan_points(plan: LapPlan) -> np.ndarray:
    """Returns points along the entry and the circuit of a plan, (n, 3) m."""
    parts = []
    for part in (plan.entry, plan.circuit):
        assert part is not None  # of NO_PLAN only
        count = max(2, round(part.duration / _PLAN_STEP))
        parts.append(part.positions(np.linspace(0.0, part.duration, count)).T)
    return np.vstack(parts)
