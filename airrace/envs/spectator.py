"""Shows an environment: a page that flies along, or what the drone's camera sees."""

import numpy as np
from pydrake.geometry import Meshcat

from airrace.math.quaternion import rotation_matrix
from airrace.rendering.imaging.motion_blur import pose_of
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.track import Track
from airrace.vehicle import Vehicle
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.state import as_plant_state
from airrace.visualization.meshcat_page import MakeMeshcat

_WIDTH, _HEIGHT, _FOV_Y_DEG = 640, 360, 55.95
_BEHIND, _ABOVE = 4.0, 1.5  # m, of the camera that flies along


class Spectator:
    """Who watches the drone of an environment; its meshcat is that of the page, after begin()."""

    def __init__(self, vehicle: Vehicle):
        """Args: vehicle: with the camera."""
        self._info = make_camera_info(
            width=_WIDTH, height=_HEIGHT, fov_y=np.deg2rad(_FOV_Y_DEG), X_BC=vehicle.camera.X_BC
        )
        self._renderer: tuple[Track, PlanarRenderer] | None = None
        self.meshcat: Meshcat | None = None

    def begin(self, track: Track) -> None:
        """Opens the page, if there is none yet; says where it is.

        Raises:
            UserError: if no port is free.
        """
        if self.meshcat is None:
            self.meshcat = MakeMeshcat(track)
            print(f"Watch it at {self.meshcat.web_url()}")

    def follow(self, state: np.ndarray) -> None:
        """Looks at the drone from behind and above; state: of the plant, (13,)."""
        drone = as_plant_state(state)
        ahead = rotation_matrix(drone.quaternion)[:, 0] * [1.0, 1.0, 0.0]
        ahead /= max(float(np.linalg.norm(ahead)), 1e-3)
        eye = drone.position - _BEHIND * ahead + [0.0, 0.0, _ABOVE]
        self.meshcat.SetCameraPose(eye, drone.position)  # type: ignore[union-attr]

    def picture(
        self, track: Track, state: np.ndarray, shifts: np.ndarray | None = None
    ) -> np.ndarray:
        """Returns what the drone's camera sees, (360, 640, 3), uint8.

        Args: state: of the plant, (13,). shifts: of gates that move, (2 n,) m.
        """
        if self._renderer is None or self._renderer[0] is not track:
            self._renderer = track, PlanarRenderer(track, self._info)
        X_WB = pose_of(as_plant_state(state))
        picture = np.empty((_HEIGHT, _WIDTH, 4), np.uint8)
        moved = None if shifts is None else shifts.reshape(-1, 2)
        self._renderer[1].render(X_WB @ self._info.X_BC, picture, moved)
        return picture[:, :, :3].copy()
