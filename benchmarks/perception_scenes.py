"""Views of marker boards at known poses, for the benchmark of the perception."""

import dataclasses as dc
import functools
import itertools

import cv2
import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from airrace.rendering.imaging.camera_effects import CameraEffects, ImagingChain
from airrace.rendering.imaging.motion_blur import MeanPicture
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.rendering.scene.scenery import AddScenery
from airrace.rendering.vtk.vtk_renderer import AddVtkRenderer
from airrace.track import Board, Gate, Track
from airrace.vehicle import CameraMount
from airrace.vehicle.camera_info import make_camera_info
from tests.worlds.pictures import CORNERS_M, look_at, one_gate

INFO = make_camera_info(width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=CameraMount().X_BC)
ONE_GATE = one_gate()
TWO_GATES = Track(
    name="two gates", gates=[*ONE_GATE.gates, Gate(left_pylon=[40.0, 5.0], heading_deg=45.0)]
)


@dc.dataclass(frozen=True)
class View:
    """A board seen by the camera.

    Attributes:
        board: what is looked at.
        X_WC: from where.
        oblique: angle between line of sight and the board's normal (rad).
    """

    board: Board
    X_WC: RigidTransform
    oblique: float

    @property
    def X_CM(self) -> RigidTransform:
        """The pose that is to be found."""
        return self.X_WC.inverse() @ self.board.X_WM

    @property
    def corners(self) -> np.ndarray:
        """Where the corners of the black square are seen, (4, 2) px."""
        return project(self.X_CM)


def project(X_CM) -> np.ndarray:
    """Returns the pixels of the black square's corners, (4, 2)."""
    p_C = INFO.K @ (X_CM @ CORNERS_M.T)
    return (p_C[:2] / p_C[2]).T


def random_view(rng, boards, distance, most_oblique) -> View:
    """Returns a random view of one of some boards, with all of it in the picture.

    Args:
        rng: a Generator.
        boards: list of Board.
        distance: from the camera (m).
        most_oblique: largest angle to the left or right of the normal (rad).
    """
    while True:
        board = boards[rng.integers(len(boards))]
        azimuth = rng.uniform(-most_oblique, most_oblique)
        elevation = rng.uniform(-0.13, 0.09)
        to_camera = np.array(
            [
                np.sin(azimuth) * np.cos(elevation),
                np.sin(elevation),
                np.cos(azimuth) * np.cos(elevation),
            ]
        )
        X_WC = look_at(board.X_WM @ (distance * to_camera), board.X_WM.translation())
        turn = RollPitchYaw(rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5))
        view = View(board, X_WC @ RigidTransform(turn, [0, 0, 0]), np.arccos(to_camera[2]))
        margin = 0.3 * np.ptp(view.corners)
        if np.all(
            (view.corners > margin) & (view.corners < [INFO.width - margin, INFO.height - margin])
        ):
            return view


def planar_camera(track, effects=CameraEffects(), *, defocus=0.0, rng=None):
    """Returns a function of X_WC that returns a picture, grey levels, (h, w), uint8.

    Args:
        track: a Track.
        effects: what a real camera does to a picture; not its distortion.
        defocus: standard deviation of a blur by the lens (px).
        rng: a Generator, for how the drone moves while the shutter is open:
            turning with 0.5 rad/s and moving with 6 m/s, root mean square of
            each component. None if it stands still.
    """
    renderer = PlanarRenderer(track, INFO)
    chain = ImagingChain(effects=effects, camera_info=INFO, seed=0)
    frames = itertools.count()

    def render(X_WC, out):
        renderer.render(X_WC, out)
        if defocus > 0:
            cv2.GaussianBlur(out, (0, 0), defocus, dst=out)

    def shoot(X_WC):
        w_WB, v_WB = (
            np.zeros((2, 3)) if rng is None else (rng.normal(0, 0.5, 3), rng.normal(0, 6.0, 3))
        )
        picture = np.zeros((INFO.height, INFO.width), np.uint8)
        expose = functools.partial(MeanPicture, render)
        X_WB = X_WC @ INFO.X_BC.inverse()
        chain.picture(expose, X_WB, w_WB, v_WB, next(frames)).draw(picture)
        return picture

    return shoot


def add_vtk_scene(builder, track, supersampling=1):
    """Adds a track for VTK; returns its SceneGraph and the renderer: see AddVtkRenderer()."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1e-3)
    AddScenery(plant, track)
    plant.Finalize()
    return scene_graph, AddVtkRenderer(scene_graph, INFO, supersampling=supersampling)


def vtk_camera(track, supersampling):
    """Returns the same of an ideal camera and VTK; see AddVtkRenderer()."""
    builder = DiagramBuilder()
    scene_graph, renderer = add_vtk_scene(builder, track, supersampling)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    port: SceneGraph = scene_graph.get_query_output_port()

    def shoot(X_WC):
        picture = np.zeros((INFO.height, INFO.width), np.uint8)
        renderer.render(X_WC, picture, port.Eval(scene_graph.GetMyContextFromRoot(context)))
        return picture

    return shoot
