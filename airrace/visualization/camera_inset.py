"""What the detector sees: the camera's picture, its frustum, and rays to what was found."""

from collections.abc import Iterable

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba
from pydrake.systems.framework import LeafSystem

from airrace.recording.foxglove_messages import raw_pixels
from airrace.rendering.imaging.motion_blur import pose_of
from airrace.systems.types import CameraInfo, Detection, Detections
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import LEFT, Audience
from airrace.visualization.picture import FixedPicture

RAYS = "rays"
_RAY_COLOR = Rgba(0.1, 1.0, 0.3, 1.0)
_FRUSTUM_COLOR = Rgba(1.0, 1.0, 1.0, 1.0)
_FRUSTUM_DEPTH = 2.0  # m
_OLDEST = 0.2  # s, of detections whose rays are shown
_MARKED = (40, 255, 80)  # RGB
_WIDTH = 320  # px, of the picture on the page


class CameraInset(LeafSystem):
    """Shows what the detector made of what the camera saw.

    .. pydrake_system::

        name: CameraInset
        input_ports:
        - truth.state
        - camera_view
        - camera_image_time
        - camera_info
        - detections

    ``truth.state`` is the plant's floating-body state (13), ``camera_view`` a CameraView,
    ``camera_image_time`` when it was taken (s), ``camera_info`` its CameraInfo, ``detections``
    a Detections.

    The picture is the very one that the detector is given, with its blur and its noise, in
    grey levels, only smaller. The markers that were found in it are framed. (If the lens
    distorts, it is the picture before it is rectified.) A ray leads to each marker. Nothing
    is drawn if nobody watches, but for the camera's frustum, once.
    """

    def __init__(self, *, meshcat: Meshcat, body_path: str, audience: Audience | None = None):
        """Constructs the inset.

        Args:
            meshcat: to draw in.
            body_path: where a MeshcatVisualizer draws the drone.
            audience: of the page.
        """
        LeafSystem.__init__(self)
        self._meshcat = meshcat
        self._picture = FixedPicture(meshcat, "camera", left=LEFT, top=-0.33, width=0.64)
        self._body_path = body_path
        self._audience = audience or Audience(meshcat)
        self._rays = False  # whether there are any on the page; see PathVisualizer
        self._state = self.DeclareVectorInputPort("truth.state", 13)
        self._view = self.DeclareAbstractInputPort("camera_view", Value[object]())
        self._time = self.DeclareVectorInputPort("camera_image_time", 1)
        self._info = self.DeclareAbstractInputPort("camera_info", Value[object]())
        self._detections = self.DeclareAbstractInputPort("detections", Value[object](Detections()))
        # Not before: at initialization the MeshcatVisualizer clears its part of the page.
        self.DeclareInitializationPublishEvent(self._draw_frustum)
        self.DeclarePeriodicPublishEvent(0.1, 0.0, self._draw)

    def _draw_frustum(self, context):
        """Draws what the camera sees, as a pyramid that moves with the drone."""
        info, path = self._info.Eval(context), f"{self._body_path}/frustum"
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
        info, detections = self._info.Eval(context), self._detections.Eval(context)
        self._draw_rays(context, info.X_BC, detections)
        # A detector that takes its time answers when there is another picture already.
        in_picture = detections.time == self._time.Eval(context)[0]
        markers = detections.markers if in_picture else ()
        self._picture.show(inset_picture(self._view.Eval(context).whole(), markers, info))

    def _draw_rays(self, context, X_BC, detections):
        """Draws lines from where the camera was to where the markers were seen."""
        age = context.get_time() - detections.time
        markers = detections.markers if 0.0 <= age <= _OLDEST else ()
        if markers:
            X_WC = pose_of(as_plant_state(self._state.Eval(context)), -age) @ X_BC
            ends = np.array([X_WC @ marker.X_CM.translation() for marker in markers]).T
            starts = np.tile(X_WC.translation()[:, None], len(markers))
            self._meshcat.SetLineSegments(RAYS, starts, ends, 2.0, _RAY_COLOR)
        elif self._rays:
            self._meshcat.Delete(RAYS)
        self._rays = bool(markers)


def inset_picture(
    picture: np.ndarray, markers: Iterable[Detection], info: CameraInfo
) -> np.ndarray:
    """Returns a camera's picture, made smaller, with a frame around each marker.

    Args:
        picture: grey levels, (h, w) uint8.
        markers: found in it, with corners as in the rectified picture.
        info: of the camera.

    Returns:
        RGB, uint8, 320 px wide.
    """
    scale = _WIDTH / info.width
    size = _WIDTH, round(scale * info.height)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    image = cv2.cvtColor(small, cv2.COLOR_GRAY2RGB)
    for marker in markers:
        # Integers are pixel centres, in both pictures.
        corners = (raw_pixels(marker.corners, info) + 0.5) * scale - 0.5
        corners = np.round(8 * corners).astype(np.int32)
        cv2.polylines(image, [corners], True, _MARKED, 1, cv2.LINE_AA, 3)
    return image
