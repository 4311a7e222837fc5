"""Pictures on the page: flat, textured rectangles that no light shades."""

import base64
import json

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat

from airrace.visualization.meshcat_page import HUD

# Before the camera: beyond its near plane, but before anything in the scene.
_DISTANCE = 0.03  # m
_NEARER = 1e-5  # share of that, of each picture than the one before
_KEPT = 32  # pictures
_FLOAT, _SHORT, _CLAMP, _LINEAR = 5126, 5123, 33071, 9729  # as OpenGL numbers them


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

    def show(self, image) -> None:
        """Shows an image.

        Args:
            image: RGB, uint8, (h, w, 3).
        """
        right = self._left + self._width
        bottom = self._top - self._width * image.shape[0] / image.shape[1]
        corners = np.array(
            [
                [self._left, bottom, 0.0],
                [right, bottom, 0.0],
                [right, self._top, 0.0],
                [self._left, self._top, 0.0],
            ]
        )
        k = self._count
        self._count += 1
        file = MemoryFile(picture_gltf(corners, image), ".gltf", self._path)
        # Smaller as it is nearer: all cover the same part of the page.
        distance = _DISTANCE / (1.0 + _NEARER * k)
        X = np.diag([distance, distance, 1.0, 1.0])
        X[2, 3] = -distance
        self._meshcat.SetTransform(f"{self._path}/{k}", X)
        self._meshcat.SetObject(f"{self._path}/{k}", Mesh(InMemoryMesh(mesh_file=file)))
        if k >= _KEPT:
            self._meshcat.Delete(f"{self._path}/{k - _KEPT}")


def picture_gltf(corners, image) -> str:
    """Returns a glTF 2.0 file of a picture, with all that belongs to it.

    Args:
        corners: lower left, lower right, upper right, upper left, (4, 3) (m), in the
            frame that the object is in, z up.
        image: RGB, uint8, (h, w, 3).
    """
    x, y, z = np.asarray(corners, float).T
    points = np.column_stack([x, z, -y]).astype(np.float32)  # glTF's y is up
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    faces = np.array([0, 1, 2, 0, 2, 3], np.uint16)
    parts = [part.tobytes() for part in (points, uv, faces)]
    offsets = np.cumsum([0, *map(len, parts)]).tolist()
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0},
        "extensions": {"KHR_materials_unlit": {}},
    }
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [
                {
                    "primitives": [
                        {
                            "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
                            "indices": 2,
                            "material": 0,
                        }
                    ]
                }
            ],
            "materials": [material],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": _CLAMP, "wrapT": _CLAMP, "minFilter": _LINEAR}],
            "images": [{"uri": _data_uri("image/jpeg", jpeg)}],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": _FLOAT,
                    "count": 4,
                    "type": "VEC3",
                    "min": points.min(axis=0).tolist(),
                    "max": points.max(axis=0).tolist(),
                },
                {"bufferView": 1, "componentType": _FLOAT, "count": 4, "type": "VEC2"},
                {"bufferView": 2, "componentType": _SHORT, "count": 6, "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteOffset": offset, "byteLength": len(part)}
                for offset, part in zip(offsets, parts)
            ],
            "buffers": [
                {
                    "byteLength": offsets[-1],
                    "uri": _data_uri("application/octet-stream", b"".join(parts)),
                }
            ],
        }
    )


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
