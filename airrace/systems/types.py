"""The values that cross abstract ports: frozen, and shared instead of copied."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from airrace.immutable import Immutable, read_only


@dc.dataclass(frozen=True, eq=False)
class CameraInfo(Immutable):
    """Calibration of a camera, as in ROS's sensor_msgs/CameraInfo.

    Pixel coordinates follow OpenCV: (0, 0) is the centre of the top left
    pixel. Camera frame C: z forward, x right, y down.

    Attributes:
        width, height: image size (px).
        K: intrinsics, (3, 3).
        D: plumb-bob distortion k1, k2, p1, p2, k3, (5,).
        R: rectification, (3, 3).
        P: projection of the rectified image, (3, 4).
        X_BC: pose of the camera in the body frame.
    """

    width: int
    height: int
    K: np.ndarray
    D: np.ndarray
    R: np.ndarray
    P: np.ndarray
    X_BC: RigidTransform


def make_camera_info(*, width, height, fov_y, X_BC) -> CameraInfo:
    """Returns the calibration of an ideal camera with square pixels.

    Args:
        width, height: image size (px).
        fov_y: vertical field of view (rad).
        X_BC: pose of the camera in the body frame.
    """
    f = height / 2 / np.tan(fov_y / 2)
    K = np.array([[f, 0.0, width / 2], [0.0, f, height / 2], [0.0, 0.0, 1.0]])
    return CameraInfo(
        width=width,
        height=height,
        K=read_only(K),
        D=read_only(np.zeros(5)),
        R=read_only(np.eye(3)),
        P=read_only(np.column_stack([K, np.zeros(3)])),
        X_BC=X_BC,
    )


@dc.dataclass(frozen=True, eq=False)
class Detection(Immutable):
    """One marker in one image.

    Attributes:
        id: the ArUco ID.
        corners: of the black square in pixels, top left first, clockwise as
            the marker is read, (4, 2).
        X_CM: pose of the marker frame in the camera frame.
        reprojection_error: RMS distance of the corners from the projection
            of X_CM (px).
    """

    id: int
    corners: np.ndarray
    X_CM: RigidTransform
    reprojection_error: float


@dc.dataclass(frozen=True, eq=False)
class Detections(Immutable):
    """All markers found in one image.

    Attributes:
        time: when the image was taken (s).
        markers: tuple of Detection.
    """

    time: float = -1.0
    markers: tuple = ()


@dc.dataclass(frozen=True, eq=False)
class MarkerEstimate(Immutable):
    """What is known of one marker.

    Attributes:
        id: the ArUco ID.
        count: number of sightings that count.
        outliers: number of sightings that were rejected.
        p_WM: mean position of the board's centre, (3,).
        variance: of each coordinate over the sightings, (3,).
        normal: mean of the unit vectors out of the board's face, (3,).
    """

    id: int
    count: int
    outliers: int
    p_WM: np.ndarray
    variance: np.ndarray
    normal: np.ndarray


@dc.dataclass(frozen=True, eq=False)
class GateEstimate(Immutable):
    """What is known of one gate.

    Attributes:
        number: of the gate, n = 0, 1, ... as in the marker IDs.
        p_WG: midpoint between the pylon axes at the boards' height, (3,).
        heading: direction of flight through it (rad).
        spacing: between the two pylon axes (m).
    """

    number: int
    p_WG: np.ndarray
    heading: float
    spacing: float

    @property
    def forward(self) -> np.ndarray:
        """Unit vector of flight, shape (3,)."""
        return np.array([np.cos(self.heading), np.sin(self.heading), 0.0])

    @property
    def pylons(self) -> np.ndarray:
        """Axes of the left and the right pylon, [x, y], (2, 2)."""
        half = self.spacing / 2 * np.array([np.sin(self.heading), -np.cos(self.heading)])
        return np.array([self.p_WG[:2] - half, self.p_WG[:2] + half])


@dc.dataclass(frozen=True, eq=False)
class GateMap(Immutable):
    """The map of the track.

    Attributes:
        time: of the newest image in it (s).
        markers: tuple of MarkerEstimate, by ID.
        gates: tuple of GateEstimate of the gates whose two pylons are known,
            by number.
        detections: number of markers detected so far.
        out_of_range: how many of them had an impossible ID.
    """

    time: float = -1.0
    markers: tuple = ()
    gates: tuple = ()
    detections: int = 0
    out_of_range: int = 0

    @property
    def error_rate(self) -> float:
        """Share of the detections with an impossible ID."""
        return self.out_of_range / max(self.detections, 1)


@dc.dataclass(frozen=True, eq=False)
class ExplorerStatus(Immutable):
    """How far the exploration is.

    Attributes:
        state: name of the explorer's state.
        reason: why it was entered.
        since: when (s).
        gates: numbers of the gates found, in the order of flight.
        closed_at: when the loop was closed (s), None before.
        done: whether it is, and the drone is ready to race.
    """

    state: str = "CALIBRATE"
    reason: str = "power on"
    since: float = 0.0
    gates: tuple = ()
    closed_at: float | None = None
    done: bool = False
