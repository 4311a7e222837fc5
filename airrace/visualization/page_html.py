"""The page of a race as HTML: Drake's Meshcat, with everything of ours put into it.

The page needs nothing beside itself. So the same page is served while a race goes on, is
left as a replay, and stands in a notebook.
"""

import base64
import functools
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from airrace.common.colors import speed_colors
from airrace.rendering.scene.textures import GRASS, HORIZON, SUN_W
from airrace.scenario.lap_limits import speed_scale_end
from airrace.vehicle import GRAVITY
from airrace.visualization.meshcat_page import overview
from airrace.visualization.race_record import script_json

if TYPE_CHECKING:
    from collections.abc import Iterable

    from airrace.scenario import Scenario
    from airrace.track import Course
    from airrace.vehicle import Vehicle

LIVE, REPLAY = "live", "replay"
_COLORS = 64  # of the scale of speeds
_MODULES = "airrace"  # what the names of our JavaScript modules begin with


@functools.cache
def _files() -> dict[str, str]:
    folder = resources.files(__package__) / "page"
    return {
        file.name: file.read_text(encoding="utf-8") for file in folder.iterdir() if file.is_file()
    }


def make_page(meshcat_html: str, config: dict, record: dict | None = None) -> str:
    """Returns Meshcat's page with ours in it.

    Args:
        meshcat_html: as a Meshcat serves it, or from its StaticHtml().
        config: from page_config().
        record: everything of a race, see RaceRecord.whole(); a live page asks for it.
    """
    files = _files()
    modules = {
        f"{_MODULES}/{name}": "data:text/javascript;base64,"
        + base64.b64encode(text.encode()).decode()
        for name, text in files.items()
        if name.endswith(".js")
    }
    head = (
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{files['page.css']}</style>\n"
        f'<script type="importmap">{script_json({"imports": modules})}</script>\n'
    )
    data = f'<script type="application/json" id="race-config">{script_json(config)}</script>\n'
    if record is not None:
        data += f'<script type="application/json" id="race-record">{script_json(record)}</script>\n'
    start = f'<script type="module">import "{_MODULES}/main.js";</script>\n'
    page = meshcat_html.replace("</head>", head + "</head>", 1)
    before, end, after = page.rpartition("</body>")
    return before + files["overlay.html"] + data + start + end + after


def page_config(
    scenario: "Scenario",
    track: "Course",
    vehicle: "Vehicle",
    body: str,
    *,
    mode: str,
    links: "Iterable[tuple[str, str]]" = (),
) -> dict[str, Any]:
    """Returns what the page needs to know of a race beside its record.

    Args:
        scenario: the race.
        track: of it.
        vehicle: that is flown.
        body: Meshcat's path of the drone, see body_path().
        mode: LIVE or REPLAY.
        links: pairs of text and address.
    """
    eye, middle = overview(track)
    camera = vehicle.camera.X_BC
    R_BC = camera.rotation().matrix()
    max_speed = speed_scale_end(scenario.planner.limits)
    speeds = np.linspace(0.0, max_speed, _COLORS)
    return {
        "mode": mode,
        "title": f"{vehicle.name} on {track.name}",
        "laps": scenario.laps,
        "gates": [
            {
                "middle": gate.p_WG.round(3).tolist(),
                "forward": gate.forward.round(5).tolist(),
                "pylons": [gate.p_WL[:2].round(3).tolist(), gate.p_WR[:2].round(3).tolist()],
            }
            for gate in track.gates
        ],
        "movingGates": scenario.disturbances.gate_shift > 0.0,
        "start": list(track.start.position[:2]),
        "middle": middle[:2].tolist(),
        "size": float(np.ptp(track.outline()[:, :2], axis=0).max()),
        "overview": {"eye": eye.tolist(), "middle": middle.tolist()},
        "body": f"drake/{body}",
        "camera": {
            "p": camera.translation().tolist(),
            "x": R_BC[:, 0].tolist(),
            "y": R_BC[:, 1].tolist(),
            "z": R_BC[:, 2].tolist(),
            "fov": scenario.camera.fov_y_deg,
            "aspect": scenario.camera.width / scenario.camera.height,
        },
        "maxThrust": round(float(vehicle.max_thrusts.sum()) / (vehicle.mass * GRAVITY), 2),
        "maxSpeed": max_speed,
        "speedColors": speed_colors(speeds, max_speed).round(3).tolist(),
        "sun": SUN_W.tolist(),
        "sky": {
            "horizon": (np.array(HORIZON) / 255).tolist(),
            "grass": (np.array(GRASS) / 255).tolist(),
        },
        "links": [list(link) for link in links],
    }
