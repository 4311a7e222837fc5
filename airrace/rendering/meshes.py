"""Textured meshes made in memory: Wavefront OBJ, material and PNG."""

import cv2
import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh

from airrace.rendering.pylon_shape import STRIPES, make_pylon_shape
from airrace.rendering.textures import (
    BOARD_BACK,
    GRASS,
    PYLON_COLOR,
    STRIPE_COLOR,
    board_image,
    grass_detail,
)
from airrace.track import BOARD_SIZE, PYLON_HEIGHT

BOARD_THICKNESS = 0.02  # (m)
GROUND_SIZE = 1200.0  # side of what is seen of the ground (m)
_GROUND_TILE = 30.0  # side of its texture (m)


def board_mesh(marker_id: int) -> InMemoryMesh:
    """Returns a board in the marker frame M: the marker faces +z at z = 0."""
    h, back = BOARD_SIZE / 2, -BOARD_THICKNESS
    corners = [(-h, -h), (h, -h), (h, h), (-h, h)]
    vertices = [(x, y, 0.0) for x, y in corners] + [(x, y, back) for x, y in corners]
    sides = [(i, 4 + i, 4 + (i + 1) % 4, (i + 1) % 4) for i in range(4)]
    # One texture shows the face and, in a strip below it, the back's colour: a
    # mesh with a single material is drawn alike by every renderer.
    face = cv2.cvtColor(board_image(marker_id), cv2.COLOR_GRAY2RGB)
    strip = np.full((len(face) // 8, *face.shape[1:]), BOARD_BACK, np.uint8)
    image = np.concatenate([face, strip])
    v0 = len(strip) / len(image)
    uv = [(0, v0), (1, v0), (1, 1), (0, 1), (0.5, v0 / 2)]
    front = ([0, 1, 2, 3], [0, 1, 2, 3])
    rest = [(quad, [4] * 4) for quad in [(7, 6, 5, 4), *sides]]
    return _textured_mesh(f"board_{marker_id}", vertices, uv, [front, *rest], image)


def pylon_mesh(sides=24, tip_rings=3) -> InMemoryMesh:
    """Returns a pylon whose foot is at the origin."""
    shape = make_pylon_shape(sides, tip_rings)
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
    h, n = GROUND_SIZE / 2, GROUND_SIZE / _GROUND_TILE
    corners = [(-h, -h, 0.0), (h, -h, 0.0), (h, h, 0.0), (-h, h, 0.0)]
    uv = [(0, 0), (n, 0), (n, n), (0, n)]
    detail = (grass_detail()[::2, ::2, None].astype(float) - 128) / 255
    image = np.clip(np.array(GRASS) - detail * [70, 70, 35], 0, 255)
    return _textured_mesh("ground", corners, uv, [([0, 1, 2, 3], [0, 1, 2, 3])], image)


def _textured_mesh(name, vertices, uv, faces, image, normals=None) -> InMemoryMesh:
    """Writes a mesh of one material.

    Args:
        name: of the mesh and its files.
        vertices: (n, 3) (m).
        uv: texture coordinates from the lower left corner, (m, 2).
        faces: pairs of lists: numbers of vertices and numbers of uv.
        image: RGB, (h, w, 3).
        normals: (n, 3); without them, faces are flat.
    """
    lines = [f"mtllib {name}.mtl", "usemtl surface"]
    lines += [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in vertices]
    lines += [f"vt {u:.6g} {v:.6g}" for u, v in uv]
    if normals is not None:
        lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in normals]
    for numbers, texture_numbers in faces:
        if normals is None:
            a, b, c = (np.array(vertices[k], float) for k in numbers[:3])
            n = np.cross(b - a, c - b)
            lines.append("vn {:.4g} {:.4g} {:.4g}".format(*n / np.linalg.norm(n)))
            last = sum(line.startswith("vn ") for line in lines)
            corners = [f"{v + 1}/{t + 1}/{last}" for v, t in zip(numbers, texture_numbers)]
        else:
            corners = [f"{v + 1}/{t + 1}/{v + 1}" for v, t in zip(numbers, texture_numbers)]
        lines.append("f " + " ".join(corners))
    material = (
        "newmtl surface\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\n"
        f"map_Kd {name}.png\n"
    )
    bgr = cv2.cvtColor(np.uint8(np.round(image)), cv2.COLOR_RGB2BGR)
    png = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    return InMemoryMesh(
        mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", f"{name}.obj"),
        supporting_files={
            f"{name}.mtl": MemoryFile(material, ".mtl", f"{name}.mtl"),
            f"{name}.png": MemoryFile(png, ".png", f"{name}.png"),
        },
    )
