"""Pictures of marker boards at known poses, and where their corners are."""

import cv2
import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from airrace.track import BOARD_SIZE, MARKER_SIZE
from airrace.vehicle.camera_info import make_camera_info

INFO = make_camera_info(width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=RigidTransform())
FACING = RotationMatrix(np.diag([1.0, -1.0, -1.0]))  # a marker that faces the camera
_H = MARKER_SIZE / 2
_CORNERS = np.array([[-_H, _H, 0], [_H, _H, 0], [_H, -_H, 0], [-_H, -_H, 0]])
_DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
_SAMPLES = 4  # of a pixel in either direction
_WHITE, _BLACK, _GREY = 235.0, 20.0, 110.0


def pose(x, y, z, pitch=0.0, yaw=0.0, roll=0.0) -> RigidTransform:
    """Returns X_CM of a marker turned away from the camera by pitch and yaw (rad)."""
    return RigidTransform(RollPitchYaw(pitch, yaw, roll).ToRotationMatrix() @ FACING, [x, y, z])


def project(X_CM) -> np.ndarray:
    """Returns the pixels of the black square's corners, (4, 2)."""
    uvw = INFO.K @ X_CM.multiply(_CORNERS.T)
    return (uvw[:2] / uvw[2]).T


def gate(X_CM, spacing=10.0, back=False) -> tuple:
    """Returns the poses of a face's left and right marker; X_CM is its middle."""
    half = RigidTransform([(-spacing if back else spacing) / 2, 0.0, 0.0])
    return X_CM @ half.inverse(), X_CM @ half


def picture(markers, blur=0.0, noise=0.0, seed=0) -> np.ndarray:
    """Returns grey levels, (720, 1280), of markers {id: X_CM} on white boards.

    Every pixel is the mean over its area.

    Args:
        markers: ID to pose.
        blur: standard deviation of a Gaussian (px).
        noise: standard deviation (grey levels).
        seed: of the noise.
    """
    image = np.full((INFO.height, INFO.width), _GREY, np.float32)
    for id, X_CM in markers.items():
        _draw(image, id, X_CM)
    if blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    image += noise * np.random.default_rng(seed).standard_normal(image.shape, np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _draw(image, id, X_CM):
    corners = project(X_CM)
    margin = 0.3 * np.ptp(corners)
    x0, y0 = np.clip(np.floor(corners.min(axis=0) - margin), 0, [1280, 720]).astype(int)
    x1, y1 = np.clip(np.ceil(corners.max(axis=0) + margin), 0, [1280, 720]).astype(int)
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    u = (np.arange(x0, x1)[:, None] + offsets).ravel()
    v = (np.arange(y0, y1)[:, None] + offsets).ravel()
    pixels = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))])
    R, p = X_CM.rotation().matrix(), X_CM.translation()
    to_plane = np.linalg.inv(INFO.K @ np.column_stack([R[:, 0], R[:, 1], p]))
    x, y, w = np.tensordot(to_plane, pixels, 1)
    x, y = x / w, y / w
    modules = cv2.aruco.generateImageMarker(_DICTIONARY, id, 7) > 0
    i, j = (np.clip(np.floor(a / MARKER_SIZE * 7), 0, 6).astype(int) for a in (_H - y, x + _H))
    white = modules[i, j] | (np.maximum(np.abs(x), np.abs(y)) > _H)
    level = np.where(white, _WHITE, _BLACK)
    on_board = np.maximum(np.abs(x), np.abs(y)) < BOARD_SIZE / 2
    level = np.where(on_board, level, np.nan).reshape(y1 - y0, _SAMPLES, x1 - x0, _SAMPLES)
    below = image[y0:y1, None, x0:x1, None]
    image[y0:y1, x0:x1] = np.where(np.isnan(level), below, level).mean(axis=(1, 3))
