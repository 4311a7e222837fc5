"""The calibration of a camera: what an image says of directions in the body frame."""

import dataclasses as dc

import numpy as np
from numpy.typing import ArrayLike
from pydrake.math import RigidTransform

from airrace.common.immutable import Immutable, read_only


@dc.dataclass(frozen=True, eq=False)
class CameraInfo(Immutable):
    """Calibration of a camera, as in ROS's sensor_msgs/CameraInfo.

    Pixel coordinates follow OpenCV: (0, 0) is the centre of the top left
    pixel. Camera frame C: z forward, x right, y down.
    """

    #: width, height: image size (px)
    width: int
    height: int
    K: np.ndarray  #: intrinsics, (3, 3)
    D: np.ndarray  #: plumb-bob distortion k1, k2, p1, p2, k3, (5,)
    R: np.ndarray  #: rectification, (3, 3)
    P: np.ndarray  #: projection of the rectified image, (3, 4)
    X_BC: RigidTransform  #: pose of the camera in the body frame


def make_camera_info(
    *, width: int, height: int, fov_y: float, X_BC: RigidTransform, D: ArrayLike = (0.0,) * 5
) -> CameraInfo:
    """Returns the calibration of a camera with square pixels; see CameraInfo.

    Args: fov_y: vertical field of view without distortion (rad).
    """
    f = height / 2 / np.tan(fov_y / 2)
    K = np.array([[f, 0.0, width / 2], [0.0, f, height / 2], [0.0, 0.0, 1.0]])
    return CameraInfo(
        width=width,
        height=height,
        K=read_only(K),
        D=read_only(D),
        R=read_only(np.eye(3)),
        P=read_only(np.column_stack([K, np.zeros(3)])),
        X_BC=X_BC,
    )
