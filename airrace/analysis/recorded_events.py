"""What happened in a race that was recorded: the events of race_events.py, from race.mcap."""

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from airrace.analysis.log import read_log, reading
from airrace.analysis.signals import odometry_numbers, seconds
from airrace.math.quaternion import rotation_matrix
from airrace.recording import race_events as events
from airrace.recording.json_topics import polynomial_trajectory, unpacked
from airrace.recording.pictures import decoded
from airrace.recording.writer import FILE
from airrace.systems.planning.lap_plan import LapPlan
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import Detection, Detections, ExplorerEvent, ExplorerStatus, GateCrossing
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.vehicle.state import State

if TYPE_CHECKING:
    from airrace.analysis.run import Run

_LONGEST = 3600.0  # s, of a part of a plan
_TRUTH, _FILTERED, _ROTORS = _SAMPLED = "/state/truth", "/state/filtered", "/rotors/measured"


def recorded_events(run: "Run", pictures: bool = True) -> Iterator[events.RaceEvent]:
    """Yields the events of a run that was recorded, in the order in which they were written.

    Numbers have the log's precision. What the page does not show is left out: of state samples,
    estimates, maps and detections a part, of policies, lost rotors and contacts all. How the race
    ended is in ``run.result``.

    Args:
        run: with its state recorded.
        pictures: whether to read those of the camera, which takes most of the time.

    Raises:
        UserError: if a message is none that this airrace writes.
    """
    readers: dict[str, Callable[[float, Any], events.RaceEvent | None]] = {
        "/imu/samples": lambda time, m: events.ImuSampled(
            time, unpacked(m["samples"], "<f8").reshape(-1, 7)
        ),
        "/detections": _detections,
        "/estimator": _estimate,
        "/map": _map,
        "/plan": _plan,
        "/plan/clock": lambda time, m: events.ClockWaits(time, m["delay"], m["goes_on"]),
        "/explorer/status": _explorer,
        "/referee/crossings": lambda time, m: events.GateCrossed(time, GateCrossing(**m)),
    }
    if run.scenario.disturbances.gate_shift:
        readers["/scene"] = functools.partial(_gates, run.track)
    if pictures:
        camera_info = run.scenario.camera.info(run.vehicle.camera.X_BC)
        readers["/camera/image"] = functools.partial(_picture, camera_info)
    path = run.folder / FILE
    sample, sampled_at = dict[str, Any](), 0.0  # messages of one StateSample, and when
    for topic, time, message in read_log(path, [*_SAMPLED, *readers]):
        if topic in readers or time != sampled_at:
            if event := _state_sample(path, sampled_at, sample):
                yield event
            sample = {}
        if topic not in readers:
            sample[topic], sampled_at = message, time
            continue
        with reading(path, f"a message of {topic}"):
            event = readers[topic](time, message)
        if event is not None:
            yield event
    if event := _state_sample(path, sampled_at, sample):
        yield event


def _state_sample(path, time, messages):
    """Returns what messages of one time say of the drone; None if they do not have the truth."""
    if _TRUTH not in messages:
        return None
    with reading(path, f"a message of {_TRUTH}"):
        speeds = (
            [each.velocity for each in messages[_ROTORS].joints] if _ROTORS in messages else None
        )
        return events.StateSample(
            time,
            _state(messages[_TRUTH]),
            filtered=_state(messages[_FILTERED]) if _FILTERED in messages else None,
            rotor_speeds=None if speeds is None else np.array(speeds),
        )


def _state(message):
    p_WB, q_WB, v_B, w_B = np.split(np.array(odometry_numbers(message)), [3, 7, 10])
    R_WB = rotation_matrix(q_WB)
    return State(seconds(message.timestamp), q_WB, p_WB, R_WB @ w_B, R_WB @ v_B)


def _detections(time, message):
    markers = [
        Detection(
            marker["id"],
            np.reshape(marker["corners"], (4, 2)),
            RigidTransform(_rotation(marker["orientation"]), marker["position"]),
            marker["reprojection_error"],
            ambiguity=marker["ambiguity"],
        )
        for marker in message["markers"]
    ]
    refused = tuple((each["reason"], each["id"]) for each in message["refused"])
    return events.DetectionsSeen(time, Detections(message["time"], tuple(markers), refused))


def _rotation(wxyz):
    return Quaternion(np.array(wxyz) / np.linalg.norm(wxyz))


def _estimate(time, message):
    names = ("attitude_error", "position_error", "velocity_error")
    error = np.array([message[name][axis] for name in names for axis in "xyz"], float)
    covariance = unpacked(message["covariance"], "<f4").reshape(9, 9)
    return events.EstimateMade(time, error, covariance.astype(float))


def _map(time, message):
    markers = tuple(
        MarkerEstimate(
            id=int(id),
            count=each["observations"],
            outliers=each["outliers"],
            p_WM=np.array(numbers[:3]),
            variance=np.array(numbers[3:]),
            normal=np.full(3, np.nan),
        )
        for (id, *numbers), each in zip(
            unpacked(message["markers"], "<f8").reshape(-1, 7), message["statistics"]["markers"]
        )
    )
    return events.MapChanged(time, GateMap(markers=markers))


def _plan(time, message):
    for each in message["polynomials"]:
        if not 0.0 <= each["breaks"][-1] - each["breaks"][0] < _LONGEST:
            raise ValueError("it takes too long")
    entry, circuit = map(polynomial_trajectory, message["polynomials"])
    numbers = message["lap"], message["start_time"]
    return events.PlanMade(time, LapPlan(*numbers, entry, circuit, message["phase"], None))


def _explorer(time, message):
    entered = tuple(ExplorerEvent(**each) for each in message.pop("entered"))
    status = ExplorerStatus(**{**message, "gates": tuple(message["gates"])})
    return events.ExplorerChanged(time, status, entered)


def _gates(track, time, message):
    """Reads where the gates stand from the numbers above them."""
    places = {text.text: text.pose.position for text in message.entities[0].texts}
    shifts = []
    for number, gate in enumerate(track.gates, 1):
        place = places[f"gate {number}"]
        shifts += [place.x - gate.p_WG[0], place.y - gate.p_WG[1]]
    return events.GatesMoved(time, np.array(shifts))


def _picture(info, time, message):
    """Returns a Picture as small as the log keeps it, None if it is none; info: at full size."""
    pixels = decoded(message.data)
    if pixels is None:
        return None
    return events.Picture(time, seconds(message.timestamp), CameraView.of(pixels), info)
