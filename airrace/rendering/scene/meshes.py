"""Textured meshes made in memory: Wavefront OBJ, material and PNG."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh

from airrace.rendering.scene.pylon_shape import STRIPES, make_pylon_shape
from airrace.rendering.scene.textures import (
    BLACK,
    BOARD_BACK,
    GRASS,
    PYLON_COLOR,
    STRIPE_COLOR,
    WHITE,
    grass_detail,
    marker_modules,
)
from airrace.track import BOARD_SIZE, MARKER_SIZE, PYLON_HEIGHT

BOARD_THICKNESS = 0.02  # (m)
_GROUND_TILE = 40.0  # side of the ground's texture (m)
_GROUND_TILES = 24  # on either axis


def board_mesh(marker_id: int) -> InMemoryMesh:
    """Returns a board in the marker frame M: the marker faces +z at z = 0.

    The marker's modules are faces, not a texture: engines smooth the edges of
    faces at any distance, but not those inside a distant texture.
    """
    colors = np.array([[BLACK] * 3, [WHITE] * 3, BOARD_BACK])
    black, white, back = range(3)
    # A row of 4 x 4 texels for each colour, used at its middle.
    image = np.repeat(np.repeat(colors[None], 4, axis=1), 4, axis=0)
    uv = [((k + 0.5) / 3, 0.5) for k in range(3)]

    module = MARKER_SIZE / 7
    h = BOARD_SIZE / 2
    lines = [-h, *(module * np.arange(-3.5, 4)), h]
    n = len(lines) - 1  # cells a side, the white border among them
    cells = np.full((n, n), white)
    cells[1:-1, 1:-1] = np.where(marker_modules(marker_id)[::-1], white, black)
    vertices = [(x, y, 0.0) for y in lines for x in lines]
    faces = []
    for j in range(n):
        for i in range(n):
            k = j * (n + 1) + i
            faces.append(([k, k + 1, k + n + 2, k + n + 1], [cells[j, i]] * 4))

    front = [0, n, (n + 1) ** 2 - 1, n * (n + 1)]  # its corners
    rear = [len(vertices) + k for k in range(4)]
    vertices += [(x, y, -BOARD_THICKNESS) for x, y, _ in (vertices[k] for k in front)]
    faces.append((rear[::-1], [back] * 4))
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces.append(([front[i], rear[i], rear[j], front[j]], [back] * 4))
    return _textured_mesh(f"board_{marker_id}", vertices, uv, faces, image)


def pylon_mesh() -> InMemoryMesh:
    """Returns a pylon whose foot is at the origin."""
    shape = make_pylon_shape(24, 3)
    # The texture is a column of colours over the height.
    rows = 240
    z = (np.arange(rows)[::-1] + 0.5) / rows * PYLON_HEIGHT
    striped = np.any([(z > low) & (z < high) for low, high in STRIPES], axis=0)
    column = np.where(striped[:, None], STRIPE_COLOR, PYLON_COLOR)
    image = np.repeat(column[:, None], 4, axis=1)
    uv = np.column_stack([np.full(len(shape.vertices), 0.5), shape.vertices[:, 2] / PYLON_HEIGHT])
    faces = [(quad, quad) for quad in shape.facets[: shape.surface].tolist()]
    return _textured_mesh("pylon", shape.vertices, uv, faces, image, shape.normals)


def ground_mesh() -> InMemoryMesh:
    """Returns a square of grass in the plane z = 0 about the origin."""
    # Render engines clamp texture coordinates to [0, 1], so every tile of the
    # texture is a face of its own.
    n = _GROUND_TILES
    grid = (np.arange(n + 1) - n / 2) * _GROUND_TILE
    vertices = [(x, y, 0.0) for y in grid for x in grid]
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    first = [j * (n + 1) + i for j in range(n) for i in range(n)]
    faces = [([k, k + 1, k + n + 2, k + n + 1], [0, 1, 2, 3]) for k in first]
    # Few grey levels make a small file.
    detail = grass_detail()[::2, ::2, None].astype(int) // 8 * 8 - 124
    image = np.clip(np.array(GRASS) - detail * [0.27, 0.27, 0.14], 0, 255)
    up = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    return _textured_mesh("ground", vertices, uv, faces, image, up)


def shadow_mesh(vertices: np.ndarray, image: np.ndarray) -> InMemoryMesh:
    """Returns what pylon_shadow() returns as a mesh."""
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return _textured_mesh("shadow", vertices, uv, [([0, 1, 2, 3], [0, 1, 2, 3])], image)


def _textured_mesh(
    name: str,
    vertices: Sequence | np.ndarray,
    uv: Iterable,
    faces: Iterable,
    image: np.ndarray,
    normals: np.ndarray | None = None,
) -> InMemoryMesh:
    """Returns a mesh of one material; name: that of its files.

    Args:
        vertices: (n, 3) m. uv: texture coordinates from the lower left corner, (m, 2).
        faces: pairs of lists: numbers of vertices and numbers of uv.
        image: RGB, (h, w, 3), or RGBA, (h, w, 4).
        normals: (n, 3); without them, faces are flat.
    """
    lines = [f"mtllib {name}.mtl", "usemtl surface"]
    lines += [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in vertices]
    lines += [f"vt {u:.6g} {v:.6g}" for u, v in uv]
    if normals is not None:
        lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in normals]
    for k, (numbers, texture_numbers) in enumerate(faces):
        if normals is None:
            a, b, c = np.array([vertices[v] for v in numbers[:3]], float)
            normal = np.cross(b - a, c - b)
            normal /= np.linalg.norm(normal)
            lines.append("vn {:.4g} {:.4g} {:.4g}".format(*normal))
        corners = [
            f"{v + 1}/{t + 1}/{(k if normals is None else v) + 1}"
            for v, t in zip(numbers, texture_numbers)
        ]
        lines.append("f " + " ".join(corners))
    material = f"newmtl surface\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {name}.png\n"
    to_bgr = cv2.COLOR_RGB2BGR if image.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
    bgr = cv2.cvtColor(np.uint8(np.round(image)), to_bgr)  # type: ignore[call-overload]
    png = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    return InMemoryMesh(
        mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", f"{name}.obj"),
        supporting_files={
            f"{name}.mtl": MemoryFile(material, ".mtl", f"{name}.mtl"),
            f"{name}.png": MemoryFile(png, ".png", f"{name}.png"),
        },
    )
