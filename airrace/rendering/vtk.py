"""Draws the scene with Drake's RenderEngineVtk."""

import ctypes

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo as DrakeCameraInfo

from airrace.errors import UserError
from airrace.rendering.textures import AMBIENT, HORIZON, SUN_W

_NAME = "vtk"


def check_vtk_available() -> None:
    """Raises UserError if this machine cannot render with VTK."""
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        raise UserError(
            "The vtk renderer needs libEGL.so.1, which is missing: install it "
            "(`apt-get install libegl1`) or use `--renderer planar`."
        ) from None


def AddVtkRenderer(scene_graph: SceneGraph, camera_info) -> "VtkRenderer":
    """Adds a render engine to the scene graph and returns a renderer for it."""
    check_vtk_available()
    params = RenderEngineVtkParams(
        default_clear_color=np.array(HORIZON) / 255,
        lights=[
            LightParameter(type="directional", direction=-SUN_W, intensity=1 - AMBIENT, frame="world"),
            LightParameter(type="directional", direction=[0, 0, 1], intensity=AMBIENT, frame="camera"),
        ],
    )
    scene_graph.AddRenderer(_NAME, MakeRenderEngineVtk(params))
    return VtkRenderer(camera_info)


class VtkRenderer:
    """Draws what is in a SceneGraph; see AddVtkRenderer()."""

    needs_query_object = True

    def __init__(self, camera_info):
        # Drake's principal point lies half a pixel up and left of where it
        # says, in OpenCV's convention.
        K = camera_info.K + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        intrinsics = DrakeCameraInfo(camera_info.width, camera_info.height, K)
        self._camera = ColorRenderCamera(
            RenderCameraCore(_NAME, intrinsics, ClippingRange(0.05, 2000.0), RigidTransform())
        )

    def render(self, X_WC, out, query_object) -> None:
        """Draws a picture.

        Args:
            X_WC: pose of the camera frame C: z forward, x right, y down.
            out: RGBA, (h, w, 4), uint8; overwritten.
            query_object: the SceneGraph's.
        """
        world = query_object.inspector().world_frame_id()
        out[:] = query_object.RenderColorImage(self._camera, world, X_WC).data
