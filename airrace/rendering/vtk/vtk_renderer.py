"""Draws the scene with Drake's RenderEngineVtk."""

import ctypes
import functools
import subprocess
import sys
from typing import TYPE_CHECKING

import cv2
import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    QueryObject,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo as DrakeCameraInfo

from airrace.common.errors import UserError
from airrace.rendering.scene.textures import HORIZON, SUN_W
from airrace.rendering.vtk.atmosphere import Atmosphere

if TYPE_CHECKING:
    from airrace.vehicle.camera_info import CameraInfo

_NAME = "vtk"
_CLIPPING = ClippingRange(0.05, 2000.0)
_DEPTHS = DepthRange(0.05, 2000.0)
_EVEN = 0.85  # of each of six lamps around, so that no face is much brighter than its colour

# Draws one small picture. Without a driver VTK does not raise but crash.
_PROBE = """
from pydrake.geometry import *
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo
scene_graph = SceneGraph()
scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
context = scene_graph.CreateDefaultContext()
query_object = scene_graph.get_query_output_port().Eval(context)
core = RenderCameraCore(
    "vtk", CameraInfo(16, 16, 1.0), ClippingRange(0.1, 1.0), RigidTransform()
)
query_object.RenderColorImage(
    ColorRenderCamera(core), SceneGraph.world_frame_id(), RigidTransform()
)
"""


@functools.cache
def check_vtk_available() -> None:
    """Checks that this machine can render with VTK, by a picture on trial.

    Raises:
        UserError: which says what is missing.
    """
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        raise UserError(
            "The vtk renderer needs libEGL.so.1, which is missing: install it "
            "(`apt-get install libegl1`) or use `--renderer planar`."
        ) from None
    try:
        trial = subprocess.run(
            [sys.executable, "-P", "-c", _PROBE], capture_output=True, timeout=120
        )
        works = trial.returncode == 0
    except subprocess.TimeoutExpired:
        works = False
    if not works:
        raise UserError(
            "The vtk renderer found no usable graphics driver behind libEGL.so.1: "
            "install one (`apt-get install libegl-mesa0 libgl1-mesa-dri`) or use "
            "`--renderer planar`."
        )


def AddVtkRenderer(
    scene_graph: SceneGraph,
    camera_info: "CameraInfo",
    *,
    supersampling: int = 1,
    indoors: bool = False,
) -> "VtkRenderer":
    """Adds a render engine to a scene graph.

    Args:
        scene_graph: the SceneGraph that AddScenery() filled.
        camera_info: calibration of the pictures; distortion is not drawn.
        supersampling: samples per pixel in either direction. Two take about
            three times as long on a CPU and halve the noise of edges.
        indoors: whether there is a hall around everything, in which all is as bright as
            its colour says, and neither haze nor sky is seen.

    Raises:
        UserError: if this machine cannot render with VTK.
    """
    check_vtk_available()

    if indoors:
        # A face's light is the sum of what falls on it from six sides: a frame of any yaw has
        # about its own colour.
        lamps = [(axis, _EVEN) for axis in np.vstack([np.eye(3), -np.eye(3)])]
    else:
        # Three lamps around and one above stand for the sky's light: what the
        # first three give to an upright board differs by 15 % with its direction.
        around = np.arctan2(SUN_W[1], SUN_W[0]) + np.deg2rad([60, 180, 300])
        lamps = [(np.array([np.cos(a), np.sin(a), 0.0]), 0.72) for a in around]
        lamps = [(-SUN_W, 0.38), (np.array([0.0, 0.0, -1.0]), 0.65), *lamps]
    lights = [
        LightParameter(type="directional", frame="world", direction=direction, intensity=intensity)
        for direction, intensity in lamps
    ]
    behind = np.zeros(3) if indoors else np.array(HORIZON) / 255
    params = RenderEngineVtkParams(default_clear_color=behind, lights=lights)
    scene_graph.AddRenderer(_NAME, MakeRenderEngineVtk(params))
    return VtkRenderer(camera_info, supersampling, atmosphere=not indoors)


class VtkRenderer:
    """Draws what is in a SceneGraph; made by AddVtkRenderer().

    Attributes:
        color_camera, depth_camera: Drake's, with which it does.
    """

    needs_query_object = True

    def __init__(self, camera_info: "CameraInfo", supersampling: int, atmosphere: bool):
        s = supersampling
        self._size = (camera_info.width, camera_info.height)
        # In OpenCV's convention pixel u covers samples s u to s u + s - 1, whose
        # centre is s u + (s - 1) / 2.
        to_samples = np.array([[s, 0, (s - 1) / 2], [0, s, (s - 1) / 2], [0, 0, 1]])

        def core(K, width, height):
            # Drake draws the principal point half a pixel up and left of where the
            # intrinsics say, in that convention.
            intrinsics = DrakeCameraInfo(width, height, K + [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
            return RenderCameraCore(_NAME, intrinsics, _CLIPPING, RigidTransform())

        w, h = self._size
        self.color_camera = ColorRenderCamera(core(to_samples @ camera_info.K, s * w, s * h))
        # Depths need no supersampling: haze is soft.
        self.depth_camera = DepthRenderCamera(core(camera_info.K, w, h), _DEPTHS)
        self._atmosphere = Atmosphere(camera_info) if atmosphere else None

    def render(self, X_WC: RigidTransform, out: np.ndarray, query_object: QueryObject) -> None:
        """Draws a picture as PlanarRenderer.render(); query_object: the SceneGraph's."""
        world = SceneGraph.world_frame_id()
        picture = query_object.RenderColorImage(self.color_camera, world, X_WC).data
        if picture.shape[1::-1] != self._size:
            picture = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        if self._atmosphere is None:
            out[:] = picture if out.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_RGBA2GRAY)
            return
        depth = query_object.RenderDepthImage(self.depth_camera, world, X_WC)
        self._atmosphere.apply(X_WC, depth.data[..., 0], picture, out)
