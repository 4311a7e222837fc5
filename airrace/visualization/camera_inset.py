"""What the drone sees: its camera's picture, its frustum, and rays to what it found."""

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.framework import LeafSystem

from airrace.rendering.imaging.motion_blur import pose_of
from airrace.systems.sensing.camera import Renderer
from airrace.systems.types import CameraInfo, Detections
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import LEFT, Audience
from airrace.visualization.picture import FixedPicture

RAYS = "rays"
_RAY_COLOR = Rgba(0.1, 1.0, 0.3, 1.0)
_FRUSTUM_COLOR = Rgba(1.0, 1.0, 1.0, 1.0)
_FRUSTUM_DEPTH = 2.0  # m
_OLDEST = 0.2  # s, of detections that are shown
_MARKED = (40, 255, 80)  # RGB


class CameraInset(LeafSystem):
    """Shows what the detector made of what the camera saw.

    .. pydrake_system::

        name: CameraInset
        input_ports:
        - truth.state
        - detections
        - truth.gate_shifts (only if gates move)

    ``truth.state`` is the plant's floating-body state (13), ``detections`` a
    Detections, ``truth.gate_shifts`` (2 n) see GateMover.

    The picture is a small one of its own, seen from where the drone was when the
    detector's image was taken, with the markers it found framed; the camera's large
    one is drawn only where the detector searches. A ray leads to each marker. Nothing
    is drawn if nobody watches, but for the camera's frustum, once.
    """

    def __init__(
        self,
        *,
        meshcat: Meshcat,
        small: CameraInfo,
        scale: float,
        renderer: Renderer,
        body_path: str,
        moving_gates: int = 0,
        audience: Audience | None = None,
    ):
        """Constructs the inset.

        Args:
            meshcat: to draw in.
            small: the camera, with fewer pixels.
            scale: of its pixels per pixel of the detector's image.
            renderer: draws its pictures; without need of a QueryObject.
            body_path: where a MeshcatVisualizer draws the drone.
            moving_gates: how many gates there are, if they move, else 0.
            audience: of the page.
        """
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._picture = FixedPicture(meshcat, "camera", left=LEFT, top=-0.33, width=0.64)
        self._info = small
        self._scale = scale
        self._renderer = renderer
        self._body_path = body_path
        self._audience = audience or Audience(meshcat)
        self._image = np.zeros((small.height, small.width, 4), np.uint8)
        self._rays = False  # whether there are any on the page; see PathVisualizer
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self._detections = self.DeclareAbstractInputPort("detections", Value[object](Detections()))
        self._shifts = None
        if moving_gates:
            self._shifts = self.DeclareVectorInputPort("truth.gate_shifts", 2 * moving_gates)
        # Not before: at initialization the MeshcatVisualizer clears its part of the page.
        self.DeclareInitializationPublishEvent(self._draw_frustum)
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw_frustum(self, context):
        """Draws what the camera sees, as a pyramid that moves with the drone."""
        info, path = self._info, f"{self._body_path}/frustum"
        u, v = info.width - 0.5, info.height - 0.5
        pixels = np.array([[-0.5, -0.5, 1], [u, -0.5, 1], [u, v, 1], [-0.5, v, 1]])
        corners = _FRUSTUM_DEPTH * np.linalg.inv(info.K) @ pixels.T
        start = np.hstack([np.zeros((3, 4)), corners])
        end = np.hstack([corners, np.roll(corners, -1, axis=1)])
        self._meshcat.SetLineSegments(path, start, end, 1.0, _FRUSTUM_COLOR)
        self._meshcat.SetTransform(path, info.X_BC)

    def _draw(self, context):
        if not self._audience.waits():
            return
        state = as_plant_state(self._state.Eval(context))
        detections = self._detections.Eval(context)
        age = context.get_time() - detections.time
        if not 0.0 <= age <= _OLDEST:
            age, detections = 0.0, Detections()
        X_WC = pose_of(state, -age) @ self._info.X_BC
        self._draw_rays(X_WC, detections.markers)
        shifts = () if self._shifts is None else (self._shifts.Eval(context).reshape(-1, 2),)
        self._renderer.render(X_WC, self._image, *shifts)
        self._picture.show(self._marked(detections.markers))

    def _marked(self, markers):
        """Returns the picture with a frame around each marker."""
        image = np.ascontiguousarray(self._image[..., :3])
        for marker in markers:
            # Integers are pixel centres, in both pictures.
            corners = (marker.corners + 0.5) * self._scale - 0.5
            cv2.polylines(
                image, [np.int32(np.round(8 * corners))], True, _MARKED, 1, cv2.LINE_AA, 3
            )
        return image

    def _draw_rays(self, X_WC, markers):
        if markers:
            ends = np.array([X_WC @ marker.X_CM.translation() for marker in markers]).T
            starts = np.tile(X_WC.translation()[:, None], len(markers))
            self._meshcat.SetLineSegments(RAYS, starts, ends, 2.0, _RAY_COLOR)
        elif self._rays:
            self._meshcat.Delete(RAYS)
        self._rays = bool(markers)
