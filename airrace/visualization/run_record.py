"""A run that was flown as its page shows it: the record of race_feed.py, from race.mcap."""

from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from airrace.analysis.log import read_log
from airrace.analysis.signals import seconds
from airrace.recording.foxglove_messages import jpeg
from airrace.recording.writer import FILE
from airrace.vehicle import GRAVITY
from airrace.visualization.race_feed import (
    KEPT_PERIOD,
    QUALITY,
    WIDTH,
    MapNews,
    crossing_text,
    estimate_data,
    event_text,
)
from airrace.visualization.race_record import (
    CROSSINGS,
    ESTIMATES,
    EVENTS,
    MAPS,
    PLANS,
    STATUS,
    RaceRecord,
    encoded,
)

if TYPE_CHECKING:
    import pandas as pd

    from airrace.analysis import Run

_RATE = 30.0  # Hz, of frames
_ESTIMATE_ROWS = 3  # of them, of which one is shown
_PLAN_ROWS = 4  # samples of a plan's log a point


def record_of(run: "Run", pictures: bool = True) -> RaceRecord:
    """Returns the record of a run that was recorded.

    Args:
        run: with its state recorded.
        pictures: whether it shows those of the camera; they are most of it.
    """
    record = RaceRecord()
    _add_frames(record, run)
    _add_events(record, run)
    _add_plans(record, run)
    _add_maps(record, run)
    _add_estimates(record, run)
    if pictures:
        _add_pictures(record, run)
    result = run.result
    end = float(run.state["time"].iloc[-1])
    exploration = result["exploration"]["time_s"]
    record.end(end, result["finished"], result["dnf_reason"], exploration)
    return record


def _add_frames(record, run):
    state = run.state
    step = max(1, round(1.0 / _RATE / float(np.median(np.diff(state["time"])))))
    rows = np.unique(np.append(np.arange(0, len(state), step), len(state) - 1))
    names = ["time", "x", "y", "z", "qw", "qx", "qy", "qz", "speed"]
    columns = [state[name].to_numpy()[rows] for name in names]
    times = columns[0]
    thrust = run.rotors.groupby("time")["thrust"].sum() if len(run.rotors) else None
    weight = run.vehicle.mass * GRAVITY
    columns.append(
        np.zeros(len(rows)) if thrust is None else np.interp(times, thrust.index, thrust) / weight
    )
    columns.append(_estimate_error(run, times))
    for frame in np.column_stack(columns):
        record.add_frame(frame)


def _estimate_error(run, times):
    """Returns how far the filtered estimate is from the truth (m); 0 without one."""
    state, filtered = run.state, run.filtered
    if not len(filtered):
        return np.zeros(len(times))
    squares = [
        np.square(
            np.interp(times, state["time"], state[axis])
            - np.interp(times, filtered["time"], filtered[axis])
        )
        for axis in "xyz"
    ]
    return np.sqrt(np.sum(squares, axis=0))


def _add_events(record, run):
    gates = 0
    for event in run.events.to_dict("records"):
        if event["source"] != "explorer":
            continue
        time, name = event["time"], event["name"]
        gates += name == "FLY_TO_GATE"
        done = name == "DONE"
        if done:
            gates = run.result["exploration"]["gates_found"]
        record.add(STATUS, time, state=name, gates=gates, done=done, racing=False)
        record.add(EVENTS, time, text=event_text(name, event["message"]))
    for each in run.crossings.to_dict("records"):
        record.add(CROSSINGS, each["time"], gate=int(each["gate"]), lap=int(each["lap"]))
        record.add(EVENTS, each["time"], text=crossing_text(each["gate"], each["offset"]))


def _add_plans(record, run):
    for plan in run.plans.to_dict("records"):
        samples = run.plan_samples[run.plan_samples["plan"] == plan["plan"]]
        points = samples[["x", "y", "z"]].to_numpy()[::_PLAN_ROWS]
        record.add(PLANS, plan["time"], lap=int(plan["lap"]), points=encoded(points))


def _add_maps(record, run):
    news = MapNews()
    columns = ["x", "y", "z", "variance_x", "variance_y", "variance_z"]
    for time, rows in run.map.groupby("time"):
        markers = zip(rows["marker"].tolist(), rows[columns].to_numpy())
        record.add(MAPS, float(time), **news.of((id, row[:3], row[3:]) for id, row in markers))


def _add_estimates(record, run):
    errors = [f"{name}_error_{axis}" for name in ("attitude", "position") for axis in "xyz"]
    entries = [f"position_covariance_{i}" for i in range(9)]
    rows = run.estimator.dropna()
    for time, *numbers in rows[["time", *errors, *entries]].to_numpy()[::_ESTIMATE_ROWS]:
        data = estimate_data(np.array(numbers[:6]), np.reshape(numbers[6:], (3, 3)))
        record.add(ESTIMATES, time, **data)


def _add_pictures(record, run):
    """Adds every so many of the log's pictures, made smaller, with the markers found in them."""
    pictures, outlines, after = {}, {}, 0.0
    for topic, written, message in read_log(
        run.folder / FILE, ["/camera/image", "/camera/annotations"]
    ):
        if topic == "/camera/image":
            if written >= after:
                after = written + KEPT_PERIOD - 0.01
                pictures[seconds(message.timestamp)] = message.data
        elif message.points and (time := seconds(message.points[0].timestamp)) in pictures:
            corners = [[(p.x, p.y) for p in each.points] for each in message.points]
            outlines[time] = {int(t.text): quad for t, quad in zip(message.texts, corners)}
    places = _marker_places(run)
    for time, data in pictures.items():
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        if picture is not None:
            height, width = picture.shape
            markers = [
                {
                    "id": id,
                    "corners": ((np.array(quad) + 0.5) / [width, height]).round(4).ravel().tolist(),
                    "p": places[round(time, 4), id],
                }
                for id, quad in outlines.get(time, {}).items()
                if (round(time, 4), id) in places
            ]
            small = jpeg(picture, min(1.0, WIDTH / width), QUALITY)
            record.add_picture(time, small, markers)


def poses_at(state: "pd.DataFrame", times: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Returns positions, (n, 3) m, and rotations R_WB of a run's table of states at times (s)."""
    at = np.clip(times, state["time"].iloc[0], state["time"].iloc[-1])
    R_WB = Rotation.from_quat(state[["qw", "qx", "qy", "qz"]].to_numpy(), scalar_first=True)
    p_WB = np.column_stack([np.interp(at, state["time"], state[axis]) for axis in "xyz"])
    return p_WB, Slerp(state["time"], R_WB)(at)


def _marker_places(run):
    """Returns where markers were seen, p_WM (m), by the picture's time (s) and the marker's ID."""
    X_BC, rows = run.vehicle.camera.X_BC, run.detections
    if not len(rows):
        return {}
    p_WB, R_WB = poses_at(run.state, rows["time"].to_numpy())
    p_CM = rows[["x", "y", "z"]].to_numpy()
    p_BM = p_CM @ X_BC.rotation().matrix().T + X_BC.translation()
    p_WM = p_WB + R_WB.apply(p_BM)
    keys = zip(rows["time"].round(4).tolist(), rows["marker"].tolist())
    return dict(zip(keys, p_WM.round(2).tolist()))
