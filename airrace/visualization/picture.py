"""Pictures on the page: flat, textured rectangles that no light shades."""

import base64
from importlib import resources

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat

from airrace.visualization.meshcat_page import HUD

# Before the camera: beyond its near plane, but before anything in the scene.
_DISTANCE = 0.03  # m
_NEARER = 1e-5  # share of that, of each picture than the one before
_KEPT = 32  # pictures
# A unit square in x and y that no light shades, as glTF 2.0; its picture goes after the prefix.
_SQUARE = (resources.files(__package__) / "picture.gltf").read_text()
_PREFIX = "data:image/jpeg;base64,"


class FixedPicture:
    """A picture that stays where it is on the page, wherever the page's camera goes.

    Its textures are files that the page fetches from the Meshcat, which forgets them
    with the object. So the newest picture hangs before the others, which stay until
    even a slow page has fetched it; nothing flickers.
    """

    def __init__(self, meshcat: Meshcat, name: str, *, left: float, top: float, width: float):
        """Constructs the picture; nothing is shown yet.

        The page's middle is at (0, 0), its upper edge at 0.77; how far it reaches to
        the sides depends on the window.

        Args:
            meshcat: of the page.
            name: of the picture.
            left, top: of its corner. width: of it, its height follows.
        """
        self._meshcat = meshcat
        self._path = f"{HUD}/{name}"
        self._left, self._top, self._width = left, top, width
        self._count = 0  # of pictures so far: output, not state

    def show(self, image: np.ndarray) -> None:
        """Shows an image.

        Args:
            image: RGB, uint8, (h, w, 3).
        """
        k = self._count
        self._count += 1
        file = MemoryFile(picture_gltf(image), ".gltf", self._path)
        # Smaller as it is nearer: all cover the same part of the page.
        distance = _DISTANCE / (1.0 + _NEARER * k)
        height = self._width * image.shape[0] / image.shape[1]
        X = np.diag([distance * self._width, distance * height, 1.0, 1.0])
        X[:3, 3] = distance * np.array([self._left, self._top - height, -1.0])
        self._meshcat.SetTransform(f"{self._path}/{k}", X)
        self._meshcat.SetObject(f"{self._path}/{k}", Mesh(InMemoryMesh(mesh_file=file)))
        if k >= _KEPT:
            self._meshcat.Delete(f"{self._path}/{k - _KEPT}")


def picture_gltf(image: np.ndarray) -> str:
    """Returns a glTF file of a unit square that shows a picture: RGB, uint8, (h, w, 3)."""
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1]
    return _SQUARE.replace(_PREFIX, _PREFIX + base64.b64encode(jpeg).decode())
