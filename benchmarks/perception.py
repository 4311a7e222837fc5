"""How well and how fast the detector sees.

    python -m benchmarks.perception [--views 200] [--frames 2000] [--seed 0] [--json FILE]

Views of single boards give the errors of corners and poses, random places of the
track student-airrace the stray markers. `clean` and `realistic` are the presets of the
scenario's camera, `blurred` adds a defocus of 0.7 px; the drone moves.
"""

import dataclasses as dc
import itertools
import sys
import time
from collections import Counter

import cv2
import numpy as np

from airrace.common.errors import UserError
from airrace.rendering.vtk.vtk_renderer import check_vtk_available
from airrace.scenario import CORNERS, POSES
from airrace.scenario.camera_config import PRESETS
from airrace.systems.perception.aruco_detector import DetectorState, detect
from airrace.systems.perception.marker_measurement import DetectorConfig, measure
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.systems.sensing.camera_view import CameraView
from airrace.track import load_track
from benchmarks import harness
from benchmarks.harness import make_list, progress
from benchmarks.perception_scenes import (
    INFO,
    ONE_GATE,
    TWO_GATES,
    planar_camera,
    project,
    random_view,
    vtk_camera,
)
from tests.worlds.pictures import look_at

_DISTANCES = (5, 10, 15, 20, 25, 30, 35, 40)  # m
_OBLIQUE = (30, 45)  # degrees
_WAY_DISTANCES = (10, 20, 30)  # m, at which the settings of corners and poses are compared
_CAMERAS = {"clean": 0.0, "realistic": 0.0, "blurred": 0.7}  # and their defocus (px)
_FLIP = np.deg2rad(15)  # a normal farther off is the other solution's
_STRAY = 10.0  # px from any board of that ID
_SEARCH = MarkerSearch()


def main(argv=None) -> int:
    """Measures and prints the tables."""
    parser = harness.make_parser(__doc__)
    parser.add_argument(
        "--views", type=harness.count, default=200, help="of each distance (default: 200)"
    )
    parser.add_argument(
        "--frames", type=harness.count, default=2000, help="to find strays in (default: 2000)"
    )
    parser.add_argument("--seed", type=int, default=0)
    return harness.run(parser, argv, measure_all, show)


def measure_all(args) -> dict:
    """Returns the figures of all tables."""
    cases = itertools.product(_CAMERAS, _OBLIQUE, _DISTANCES)
    return {
        "accuracy": [
            measure_accuracy(*case, args.views, args.seed)
            for case in progress(list(cases), "Views")
        ],
        "ways": [
            row
            for distance in progress(_WAY_DISTANCES, "Settings")
            for row in compare_ways(distance, args.views, args.seed)
        ],
        "renderers": compare_renderers(args.views, args.seed),
        "strays": count_strays(args.frames, args.seed),
        "time": measure_time(),
    }


def show(results: dict) -> tuple[list, bool]:
    """Returns the tables; there are no bounds."""
    tables = [
        make_accuracy_table(results["accuracy"]),
        make_ways_table(results["ways"]),
        make_list("Corners, planar against vtk", results["renderers"]),
        make_list("Stray markers over the track student-airrace", results["strays"]),
        make_list("Time of one frame, one thread", results["time"]),
    ]
    return tables, True


def make_camera(name, rng):
    """Returns one of _CAMERAS, see planar_camera()."""
    effects = PRESETS.get(name, PRESETS["realistic"])
    return planar_camera(ONE_GATE, effects, defocus=_CAMERAS[name], rng=rng)


def measure_accuracy(camera, most_oblique_deg, distance, count, seed) -> dict:
    """Compares views of random boards at one distance with the truth."""
    rng = np.random.default_rng(seed)
    shoot = make_camera(camera, rng)
    errors, radial, single, joint = [], [], [], []
    for _ in range(count):
        view = random_view(rng, ONE_GATE.boards(), distance, np.deg2rad(most_oblique_deg))
        grey = shoot(view.X_WC)
        ids, quads = _SEARCH.everywhere(grey)
        seen = CameraView.of(grey)
        near = [i for i, id in enumerate(ids) if id == view.board.id]
        alone, _ = measure(seen, [ids[i] for i in near], quads[near], INFO)
        if not alone:
            continue
        error = alone[0].corners - view.corners
        outward = view.corners - view.corners.mean(axis=0)
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        errors.append(error)
        radial.append(np.sum(error * outward, axis=1).mean())
        single.append(pose_error(alone[0].X_CM, view.X_CM))
        together, _ = measure(seen, ids, quads, INFO)
        joint += [
            pose_error(m.X_CM, view.X_CM) for m in together if m.id == view.board.id and m.joint
        ]
    ranges, angles = np.reshape(single, (-1, 2)).T
    joint_ranges = [error[0] for error in joint] or [np.nan]
    return {
        "camera": camera,
        "most_oblique_deg": most_oblique_deg,
        "distance_m": distance,
        "found": len(errors) / count,
        "corner_rms_px": float(np.sqrt(2 * np.mean(np.square(errors)))),
        "radial_bias_px": float(np.mean(radial)),
        "range_bias": float(np.mean(ranges)),
        "range_spread": float(np.std(ranges)),
        "flips": float(np.mean(angles > _FLIP)),
        "joint_range_bias": float(np.mean(joint_ranges)),
        "joint_range_spread": float(np.std(joint_ranges)),
    }


def pose_error(found, true):
    """Returns the relative error of the range, and the angle between normals (rad)."""
    ratio = np.linalg.norm(found.translation()) / np.linalg.norm(true.translation())
    cosine = found.rotation().col(2) @ true.rotation().col(2)
    return ratio - 1, np.arccos(np.clip(cosine, -1, 1))


def compare_ways(distance, count, seed) -> list[dict]:
    """Compares the settings of corners and poses, in the same random views at one distance.

    The camera is `realistic`, and up to 30 degrees off the board's normal.
    """
    rng = np.random.default_rng(seed)
    shoot = make_camera("realistic", rng)
    searches = {corners: MarkerSearch(refine=corners == "opencv") for corners in CORNERS}
    errors = {way: [] for way in itertools.product(CORNERS, POSES)}
    for _ in range(count):
        view = random_view(rng, ONE_GATE.boards(), distance, np.deg2rad(30))
        grey = shoot(view.X_WC)
        for corners, search in searches.items():
            ids, quads = search.everywhere(grey)
            for poses in POSES:
                config = DetectorConfig(corners=corners, poses=poses)
                markers, _ = measure(CameraView.of(grey), ids, quads, INFO, config)
                errors[corners, poses] += [
                    pose_error(m.X_CM, view.X_CM) for m in markers if m.id == view.board.id
                ]
    rows = []
    for (corners, poses), found in errors.items():
        ranges, angles = np.reshape(found, (-1, 2)).T
        rows.append(
            {
                "corners": corners,
                "poses": poses,
                "distance_m": distance,
                "found": len(found) / count,
                "range_bias_m": distance * float(np.mean(ranges)),
                "range_spread_m": distance * float(np.std(ranges)),
                "flips": float(np.mean(angles > _FLIP)),
            }
        )
    return rows


def compare_renderers(count, seed) -> dict:
    """Compares the corners that are found in pictures of the two renderers."""
    try:
        check_vtk_available()
    except UserError as e:
        return {"vtk": str(e)}
    rng = np.random.default_rng(seed)
    cameras = {
        "planar": planar_camera(ONE_GATE),
        "vtk": vtk_camera(ONE_GATE, 1),
        "vtk, supersampled": vtk_camera(ONE_GATE, 2),
    }
    corners = {name: [] for name in cameras}
    for _ in progress(range(max(count // 4, 1)), "Renderers"):
        view = random_view(rng, ONE_GATE.boards(), rng.uniform(4, 30), np.deg2rad(45))
        found = {name: find(shoot(view.X_WC), view.board.id) for name, shoot in cameras.items()}
        if all(corner is not None for corner in found.values()):
            for name in cameras:
                corners[name].append(found[name])
    result = {"views": len(corners["planar"])}
    for name in list(cameras)[1:]:
        difference = np.array(corners["planar"]) - corners[name]
        result[f"{name}: mean offset (px)"] = np.abs(difference.mean(axis=(0, 1))).max()
        result[f"{name}: RMS (px)"] = np.sqrt(2 * np.mean(difference**2))
    return {name: float(value) for name, value in result.items()}


def find(picture, id):
    """Returns the refitted corners of a marker, (4, 2) px, or None."""
    ids, quads = _SEARCH.everywhere(picture)
    markers, _ = measure(CameraView.of(picture), ids, quads, INFO)
    return next((m.corners for m in markers if m.id == id), None)


def count_strays(count, seed) -> dict:
    """Takes pictures above the track student-airrace, of which every second one is blurred."""
    rng = np.random.default_rng(seed)
    race = load_track("student-airrace")
    boards = {board.id: board.X_WM for board in race.boards()}
    # Defocus and a shutter open for so long blur by several pixels.
    blurred = dc.replace(PRESETS["realistic"], shutter=0.012)
    cameras = (planar_camera(race), planar_camera(race, blurred, defocus=0.8, rng=rng))
    result = Counter(frames=count, markers=0, strays=0)
    for i in progress(range(count), "Strays"):
        gate = race.gates[rng.integers(len(race.gates))]
        p_WC = gate.p_WG + rng.uniform([-40, -40, -5], [40, 40, 5])
        X_WC = look_at(p_WC, gate.p_WG + rng.uniform(-8, 8, 3))
        state = detect(_SEARCH, CameraView.of(cameras[i % 2](X_WC)), 0.0, INFO, DetectorState())
        for marker in state.detections.markers:
            result["markers"] += 1
            X_WM = boards.get(marker.id)
            true = np.inf if X_WM is None else project(X_WC.inverse() @ X_WM)
            result["strays"] += int(np.abs(marker.corners - true).max() > _STRAY)
        for reason, _ in state.detections.refused:
            result[f"refused: {reason}"] += 1
    return dict(result)


def measure_time() -> dict:
    """Times four markers in one frame, as milliseconds and ratios."""
    picture = planar_camera(TWO_GATES)(look_at(np.array([5.0, -2.0, 6.0]), [20.0, 0.0, 6.25]))
    plain = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    )
    view = CameraView.of(picture)
    first = detect(_SEARCH, view, 0.0, INFO, DetectorState())
    assert len(first.measured) == 4
    calls = {
        "plain": lambda: plain.detectMarkers(picture),
        "full": lambda: detect(_SEARCH, view, 1.0, INFO, DetectorState()),
        "tracked": lambda: detect(_SEARCH, view, 1 / 30, INFO, first),
    }
    # By turns, so that whatever else the machine does slows down all of them.
    spent = {name: [] for name in calls}
    for _ in range(40):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            spent[name].append(time.perf_counter() - start)
    ms = {f"{name} (ms)": 1e3 * float(np.median(t)) for name, t in spent.items()}
    return ms | {
        "full / plain": ms["full (ms)"] / ms["plain (ms)"],
        "tracked / plain": ms["tracked (ms)"] / ms["plain (ms)"],
    }


def make_accuracy_table(rows):
    """Returns the table of measure_accuracy(), one row a distance."""
    columns = {
        "camera": "{camera}",
        "up to (deg)": "{most_oblique_deg}",
        "distance (m)": "{distance_m}",
        "found": "{found:.3f}",
        "corner RMS (px)": "{corner_rms_px:.3f}",
        "radial bias (px)": "{radial_bias_px:+.3f}",
        "range bias": "{range_bias:+.2%}",
        "spread": "{range_spread:.2%}",
        "flips": "{flips:.1%}",
        "joint bias": "{joint_range_bias:+.2%}",
        "joint spread": "{joint_range_spread:.2%}",
    }
    title = "One marker, random views; and the same jointly with the gate's other"
    return harness.make_table(title, rows, columns)


def make_ways_table(rows):
    """Returns the table of compare_ways()."""
    columns = {
        "corners": "{corners}",
        "poses": "{poses}",
        "distance (m)": "{distance_m}",
        "found": "{found:.3f}",
        "range bias (cm)": lambda row: f"{100 * row['range_bias_m']:+.1f}",
        "spread (cm)": lambda row: f"{100 * row['range_spread_m']:.1f}",
        "flips": "{flips:.1%}",
    }
    return harness.make_table("perception: {corners: ..., poses: ...}", rows, columns)


if __name__ == "__main__":
    sys.exit(main())
