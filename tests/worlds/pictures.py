"""Camera poses, projections and measurements in pictures for the tests."""

import functools

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.rendering.imaging.motion_blur import MeanPicture
from airrace.track import MARKER_SIZE, Gate, Track
from airrace.vehicle.camera_info import make_camera_info

# C in the body: z forward, x right, y down.
R_BC = RotationMatrix(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
CAMERA_INFO = make_camera_info(
    width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=RigidTransform(R_BC, [0, 0, 0])
)

# The black square's corners in M: upper left first, then clockwise as seen.
CORNERS_M = MARKER_SIZE / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])


def one_gate() -> Track:
    """Returns a gate across the x axis, flown through along +x, midpoint x = 20."""
    return Track(name="one gate", gates=[Gate(left_pylon=[20.0, 5.0], heading_deg=0.0)])


def new_picture(camera_info=CAMERA_INFO) -> np.ndarray:
    """Returns an RGBA picture full of a colour that no renderer draws."""
    return np.full((camera_info.height, camera_info.width, 4), 77, np.uint8)


def count_colours(picture: np.ndarray) -> int:
    """Returns how many colours a picture has, (height, width, 3) of bytes."""
    # As numbers: to sort the rows of three takes seconds.
    return len(np.unique(picture.astype(int) @ [1 << 16, 1 << 8, 1]))


def look_at(p_WC, target_W, roll=0.0) -> RigidTransform:
    """Returns the pose of a camera that has the target in its centre.

    Args:
        p_WC: where the camera is, (3,).
        target_W: what it looks at, (3,), neither above nor below it.
        roll: to the right (rad).
    """
    z = np.subtract(target_W, p_WC)
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R_WC = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R_WC @ RotationMatrix.MakeZRotation(roll), p_WC)


def project(K, X_WC, p_W) -> np.ndarray:
    """Returns the pixels, (n, 2), and depths, (n,), of points in world, (n, 3)."""
    p_C = X_WC.inverse() @ np.asarray(p_W, float).T
    return (K @ p_C)[:2].T / p_C[2][:, None], p_C[2]


def grey(image) -> np.ndarray:
    """Returns the mean of red, green and blue, (h, w), float32."""
    return image[..., :3].astype(np.float32).mean(axis=2)


def measure_corners(image, expected) -> np.ndarray:
    """Returns the corners of a dark square on bright ground, (4, 2) pixels.

    Along each edge's normals the edge lies at the centroid of the brightness
    gradient, which no symmetric blur moves. Lines fitted to these points are
    intersected.

    Args:
        image: grey levels, (h, w), float32.
        expected: corners to a pixel or so, (4, 2).
    """
    lines = []
    for a, b in zip(expected, np.roll(expected, -1, axis=0)):
        length = np.linalg.norm(b - a)
        along = (b - a) / length
        normal = np.array([-along[1], along[0]])
        # The black frame is 1/7 of the marker wide and the white border 1/8;
        # the profile ends well within them.
        width = np.sort(np.abs((expected - a) @ normal))[2]
        reach = min(8.0, 0.075 * width)
        across = np.arange(-reach, reach + 0.01, 0.1)
        t = np.linspace(0.18, 0.82, 60) * length
        points = a + t[:, None, None] * along + across[None, :, None] * normal
        profile = cv2.remap(image, points.astype(np.float32), None, cv2.INTER_LINEAR).astype(float)
        gradient = np.diff(profile, axis=1)
        middle = (across[1:] + across[:-1]) / 2
        offset = gradient @ middle / gradient.sum(axis=1)
        slope, shift = np.polyfit(t, offset, 1)
        lines.append((a + shift * normal, along + slope * normal))
    corners = []
    for (p, d), (q, e) in zip([lines[-1], *lines], lines):
        s = np.linalg.solve(np.column_stack([d, -e]), q - p)
        corners.append(p + s[0] * d)
    return np.array(corners)


def take_picture(chain, render, X_WB, w_WB, v_WB, frame, out):
    """Takes a picture through an ImagingChain with a renderer that draws whole ones."""
    expose = functools.partial(MeanPicture, render)
    chain.picture(expose, X_WB, w_WB, v_WB, frame).draw(out)
