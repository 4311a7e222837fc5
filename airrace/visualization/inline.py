"""3-D views in notebooks: pages of Drake's Meshcat that need no server once they are there."""

import dataclasses as dc
import html
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airrace.common.colors import speed_colors
from airrace.rendering.scene.scenery import AddScenery
from airrace.visualization.meshcat_page import MakeMeshcat, draw_bodies
from airrace.visualization.tubes import tube

if TYPE_CHECKING:
    from airrace.analysis.run import Run
    from airrace.track import Track

_RADIUS = 0.12  # m


@dc.dataclass(frozen=True)
class Frame:
    """A page in a frame, which a notebook shows where it is the last line of a cell.

    The page is part of the notebook's output. So it needs neither a port nor a file, and
    still works when the notebook is opened elsewhere.
    """

    page: str  # HTML
    height: int  # px

    def _repr_html_(self):
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def show_page(page: str | Path, height: int = 480) -> Frame:
    """Returns a page for a notebook.

    Args:
        page: HTML, or the path of a file of it, such as a run's report.html.
        height: of the frame (px).
    """
    return Frame(page.read_text(encoding="utf-8") if isinstance(page, Path) else page, height)


def show_runs(*runs: "Run", align: str = "start", height: int = 480) -> Frame:
    """Returns a replay of runs of one track for a notebook, with controls to play it.

    Args:
        runs: from airrace.analysis.load_run().
        align: "start", or "lap": all cross gate 1 at the same time.
        height: of the frame (px).

    Raises:
        UserError: if they cannot be shown together.
    """
    from airrace.visualization.ghosts import make_ghosts, replay_page

    # The page becomes part of the notebook, so it does without the camera's pictures.
    return show_page(replay_page(make_ghosts(runs, align), pictures=False), height)


def show_paths(
    track: "Track",
    paths: Iterable[tuple[np.ndarray, np.ndarray]],
    max_speed: float = 20.0,
    height: int = 480,
) -> Frame:
    """Returns a view of a track with paths for a notebook, coloured by speed.

    Args:
        track: a Track.
        paths: pairs of positions, (n, 3) m, and speeds, (n,) m/s.
        max_speed: at the end of the scale (m/s).
        height: of the frame (px).
    """
    meshcat = MakeMeshcat(track)
    draw_bodies(meshcat, lambda plant, _: AddScenery(plant, track))
    for k, (positions, speeds) in enumerate(paths):
        vertices, faces = tube(positions, _RADIUS)
        colors = np.repeat(speed_colors(speeds, max_speed), 3, axis=0).T
        meshcat.SetTriangleColorMesh(f"paths/{k}", vertices, faces, colors)
    return show_page(meshcat.StaticHtml(), height)
