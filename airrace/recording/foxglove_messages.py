"""Values that cross our ports as Foxglove's messages.

Numbers that change all the time have single precision, 10 um at 100 m: the lower half
of a double would only be noise that cannot be compressed.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import cv2
import numpy as np
from foxglove import messages as fg

from airrace.math.quaternion import rotation_matrix
from airrace.systems.types import Detections
from airrace.trajopt.reference import Reference
from airrace.vehicle.camera_info import CameraInfo
from airrace.vehicle.state import State

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

WORLD, BODY, CAMERA = "world", "body", "camera"  # frames
_GREEN, _SHADE = fg.Color(r=0.2, g=0.9, b=0.3, a=1.0), fg.Color(r=0.0, g=0.0, b=0.0, a=0.5)


def nanoseconds(time: float) -> int:
    """Returns a simulated time (s) as a log's time; a race starts at 0."""
    return round(time * 1e9)


def stamp(time: float) -> fg.Timestamp:
    """Returns a simulated time (s) as a message's."""
    return fg.Timestamp(*divmod(nanoseconds(time), 1_000_000_000))


def vector3(values: Iterable[float]) -> fg.Vector3:
    """Returns three numbers as a Vector3."""
    x, y, z = _single(values)
    return fg.Vector3(x=x, y=y, z=z)


def quaternion(values: Iterable[float]) -> fg.Quaternion:
    """Returns w, x, y and z as a Quaternion."""
    w, x, y, z = _single(values)
    return fg.Quaternion(x=x, y=y, z=z, w=w)


def pose(position: Iterable[float], orientation: Iterable[float] = (1.0, 0.0, 0.0, 0.0)) -> fg.Pose:
    """Returns a position (m) and a quaternion w, x, y, z as a Pose."""
    return fg.Pose(position=vector3(position), orientation=quaternion(orientation))


def _single(values: Iterable[float]) -> list:
    """Returns numbers rounded to single precision."""
    return np.asarray(values, np.float32).tolist()


def odometry(state: State) -> fg.Odometry:
    """Returns a state as Foxglove defines it: velocities in the body's frame."""
    R_BW = rotation_matrix(state.quaternion).T
    return fg.Odometry(
        timestamp=stamp(state.time),
        frame_id=WORLD,
        body_frame_id=BODY,
        pose=pose(state.position, state.quaternion),
        linear_velocity=vector3(R_BW @ state.velocity),
        angular_velocity=vector3(R_BW @ state.angular_velocity),
    )


def reference_odometry(time: float, reference: Reference) -> fg.Odometry:
    """Returns the part of a reference that Odometry has fields for.

    Its body frame is level, turned by the yaw.
    """
    half = reference.yaw / 2
    return odometry(
        State(
            time,
            np.array([np.cos(half), 0.0, 0.0, np.sin(half)]),
            reference.position,
            np.array([0.0, 0.0, reference.yaw_rate]),
            reference.velocity,
        )
    )


def rotors(time: float, speeds: np.ndarray, thrust_coefficients: np.ndarray) -> fg.JointStates:
    """Returns the speeds of rotors (rad/s), and the thrusts that belong to them (N)."""
    thrusts = _single(thrust_coefficients * np.square(speeds))
    return fg.JointStates(
        timestamp=stamp(time),
        joints=[
            fg.JointState(name=f"rotor_{i}", velocity=w, effort=thrust)
            for i, (w, thrust) in enumerate(zip(_single(speeds), thrusts), 1)
        ],
    )


def transforms(state: State, X_BC: "RigidTransform") -> fg.FrameTransforms:
    """Returns where the body is, and the camera in it; X_BC: RigidTransform."""
    mount = X_BC.translation(), X_BC.rotation().ToQuaternion().wxyz()
    return fg.FrameTransforms(
        transforms=[
            fg.FrameTransform(
                timestamp=stamp(state.time),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=vector3(translation),
                rotation=quaternion(rotation),
            )
            for parent, child, translation, rotation in (
                (WORLD, BODY, state.position, state.quaternion),
                (BODY, CAMERA, *mount),
            )
        ]
    )


def calibration(time: float, info: CameraInfo, scale: float = 1.0) -> fg.CameraCalibration:
    """Returns a camera's calibration, for pictures made smaller by a factor."""

    def scaled(matrix):
        # Integers are pixel centres, so the picture's corner is at -0.5.
        shift = np.array(
            [[scale, 0.0, 0.5 * scale - 0.5], [0.0, scale, 0.5 * scale - 0.5], [0.0, 0.0, 1.0]]
        )
        return (shift @ matrix).ravel().tolist()

    return fg.CameraCalibration(
        timestamp=stamp(time),
        frame_id=CAMERA,
        width=round(scale * info.width),
        height=round(scale * info.height),
        distortion_model="plumb_bob",
        D=info.D.tolist(),
        K=scaled(info.K),
        R=info.R.ravel().tolist(),
        P=scaled(info.P),
    )


def jpeg(picture: np.ndarray, scale: float, quality: int) -> bytes:
    """Returns a picture, (h, w) uint8, made smaller by a factor, as a JPEG file."""
    if scale < 1.0:
        size = tuple(round(scale * n) for n in reversed(picture.shape))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def image(time: float, jpeg: bytes) -> fg.CompressedImage:
    """Returns a picture taken at a time (s)."""
    return fg.CompressedImage(timestamp=stamp(time), frame_id=CAMERA, data=jpeg, format="jpeg")


def raw_pixels(pixels: np.ndarray, info: CameraInfo) -> np.ndarray:
    """Returns where points of the rectified picture are in what the camera took.

    Args:
        pixels: (n, 2) px.
        info: of the camera.

    Returns:
        (n, 2) px.
    """
    if not info.D.any() or not len(pixels):  # of no points OpenCV makes None
        return np.asarray(pixels)
    points = np.column_stack([pixels, np.ones(len(pixels))])
    rays = np.linalg.solve(info.P[:, :3] @ info.R, points.T)
    return cv2.projectPoints(rays.T.copy(), np.zeros(3), np.zeros(3), info.K, info.D)[0][:, 0]


def annotations(
    detections: Detections, info: CameraInfo, scale: float = 1.0
) -> fg.ImageAnnotations:
    """Returns outlines and IDs of markers, for a camera's pictures made smaller by a factor."""
    time = stamp(detections.time)
    points, texts = [], []
    corners = np.concatenate([m.corners for m in detections.markers] or [np.zeros((0, 2))])
    pixels = scale * (raw_pixels(corners, info) + 0.5) - 0.5
    for marker, quad in zip(detections.markers, pixels.round(2).reshape(-1, 4, 2).tolist()):
        outline = [fg.Point2(x=u, y=v) for u, v in quad]
        points.append(
            fg.PointsAnnotation(
                timestamp=time,
                type=fg.PointsAnnotationType.LineLoop,
                points=outline,
                outline_color=_GREEN,
                thickness=2.0,
            )
        )
        texts.append(
            fg.TextAnnotation(
                timestamp=time,
                position=outline[0],
                text=str(marker.id),
                font_size=14.0,
                text_color=_GREEN,
                background_color=_SHADE,
            )
        )
    return fg.ImageAnnotations(timestamp=time, points=points, texts=texts)


def log(time: float, name: str, message: str, *, bad: bool = False) -> fg.Log:
    """Returns a line of a log; bad: whether it is an error."""
    level = fg.LogLevel.Error if bad else fg.LogLevel.Info
    return fg.Log(timestamp=stamp(time), level=level, name=name, message=message)
