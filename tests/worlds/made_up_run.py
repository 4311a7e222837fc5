"""A run that nobody flew, whose numbers are known."""

import json

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from airrace.recording import foxglove_messages, json_topics
from airrace.recording.writer import FILE, RaceLog
from airrace.scenario import VIO, Scenario, scenario_yaml
from airrace.systems.estimation.kalman_update import Belief
from airrace.systems.estimation.landmarks import Landmark
from airrace.systems.estimation.slam_state import SlamState
from airrace.systems.types import Detection, Detections, GateCrossing
from airrace.track import load_track
from airrace.track.gate_map import GateMap, MarkerEstimate
from airrace.trajopt.reference import as_reference
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import State

GATES, LAP, FIRST = 10, 5.0, 2.0  # gates; s a lap; s, when gate 1 is crossed first
OFF = 0.03  # m, off the reference, to the left
TURN_RATE, RADIUS = 2 * np.pi / LAP, 30.0
MAP_ERROR = 0.02  # m, in x, of every marker
WAITED = 0.3  # s, of the second lap, by the clock of plans


def flight(time):
    """Position, velocity and quaternion on a level circle about the z axis, nose ahead."""
    a = TURN_RATE * (time - FIRST)
    c, s = np.cos(a), np.sin(a)
    p = np.array([RADIUS * c, RADIUS * s, 6.0])
    v = RADIUS * TURN_RATE * np.array([-s, c, 0.0])
    q = RotationMatrix.MakeZRotation(a + np.pi / 2).ToQuaternion().wxyz()
    return p, v, q


def crossings(laps):
    """GateCrossings at even times."""
    step = LAP / GATES
    return [
        GateCrossing(
            time=FIRST + k * step,
            gate=k % GATES + 1,
            lap=k // GATES + 1,
            offset=0.1,
            max_speed=20.0,
        )
        for k in range(laps * GATES + 1)
    ]


def race_json(laps, finished=True):
    """What race.json holds of the run."""
    flown = crossings(laps)
    return {
        "track": "student-airrace",
        "drone": "Default",
        "trajectory": "6",
        "limits": "original",
        "seed": 0,
        "rotor_failures": [],
        "finished": finished,
        "dnf_reason": None if finished else "touched <pylon_3_left>",
        "exploration": {
            "success": True,
            "time_s": 1.5,
            "gates_found": GATES,
            "events": [
                {"time_s": 0.0, "state": "CALIBRATE", "reason": "power on"},
                {"time_s": 0.5, "state": "TAKE_OFF", "reason": "level"},
            ],
        },
        "laps": [
            {
                "lap": k + 1,
                "start_s": flown[GATES * k].time,
                "time_s": LAP,
                **({"waited_s": WAITED} if k == 1 else {}),
                "gate_times_s": [LAP / GATES * i for i in range(GATES)],
                "gate_offsets_m": [0.1] * GATES,
                "max_speed": 20.0,
                "map_rms_m": MAP_ERROR,
                "plan": {
                    "number": 1,
                    "duration_s": LAP - 0.2,
                    "max_speed": 20.0,
                    "max_acceleration": 10.0,
                    "max_rotor_thrust": 5.0,
                },
            }
            for k in range(laps)
        ],
        "mean_lap_s": LAP if laps else None,
        "best_lap_s": LAP if laps else None,
        "collisions": 0,
        "wall": {"simulation": "SITL", "seconds": 1.0, "real_time_factor": 1.0},
    }


def made_up_map(time):
    """A GateMap of all boards, each off by MAP_ERROR."""
    return GateMap(
        time,
        tuple(
            MarkerEstimate(
                id=board.id,
                count=7,
                outliers=1,
                normal=np.array([1.0, 0, 0]),
                p_WM=board.X_WM.translation() + [MAP_ERROR, 0, 0],
                variance=np.full(3, 1e-4),
            )
            for board in load_track("student-airrace").boards()
        ),
    )


def write_log(log, laps, rotors=4):
    """Writes the signals of the run to a RaceLog."""
    coefficients = np.full(rotors, 1e-3)
    end = FIRST + laps * LAP
    for time in np.arange(0.0, end + 0.5, 0.02).tolist():
        p, v, q = flight(time)
        state = State(time, q, p, np.array([0.0, 0.0, TURN_RATE]), v)
        for name in ("truth", "estimate", "filtered"):
            log.write(f"/state/{name}", time, foxglove_messages.odometry(state))
        sample = np.array([time - 0.001, 0.0, 0.0, TURN_RATE, 1.0, 2.0, 9.81])
        if time > 2.0:  # it fails
            sample[1:] = np.nan
        log.write("/imu", time, json_topics.imu_data(sample))
        left = OFF * np.array([-v[1], v[0], 0.0]) / np.linalg.norm(v)
        yaw = TURN_RATE * (time - FIRST) + np.pi / 2
        reference = as_reference(np.array([*(p - left), *v, *np.zeros(9), yaw, TURN_RATE, 0.0]))
        log.write("/reference", time, foxglove_messages.reference_odometry(time, reference))
        log.write("/reference/acceleration", time, foxglove_messages.vector3([1.0, 2.0, 3.0]))
        log.write(
            "/rotors/measured", time, foxglove_messages.rotors(time, [40.0] * rotors, coefficients)
        )
        log.write(
            "/rotors/command", time, foxglove_messages.rotors(time, [50.0] * rotors, coefficients)
        )
    jpeg = cv2.imencode(".jpg", np.full((36, 64), 128, np.uint8))[1].tobytes()
    for time in np.arange(0.0, end, 0.2).tolist():
        log.write("/camera/image", time, foxglove_messages.image(time, jpeg))
    marker = Detection(
        id=5, corners=np.zeros((4, 2)), X_CM=RigidTransform([0.0, 3.0, 4.0]), reprojection_error=0.1
    )
    log.write(
        "/detections",
        1.04,
        json_topics.detections_data(Detections(1.0, (marker,), (("image too dark", None),))),
    )
    for crossing in crossings(laps):
        log.write("/referee/crossings", crossing.time, json_topics.crossing_data(crossing))
        if crossing.gate == 1:
            log.write(
                "/map", crossing.time + 0.01, json_topics.full_map_data(made_up_map(crossing.time))
            )
    samples = {name: [0.0, 1.0] for name in json_topics.PLAN_COLUMNS}
    rest = {"breaks": [0.0, 1.0], "coefficients": json_topics.packed(np.zeros((1, 4, 1)), "<f8")}
    log.write(
        "/plan",
        1.0,
        {
            "lap": 1,
            "start_time": 1.0,
            "entry_duration": 1.0,
            "phase": 0.0,
            "duration": LAP - 0.2,
            "gate_times": np.linspace(0.0, LAP - 0.2, GATES + 1).tolist(),
            "step": 0.02,
            "entry": samples,
            "circuit": samples,
            "polynomials": [rest, rest],
        },
    )
    for time, goes_on in ((FIRST + 1.2 * LAP, True), (FIRST + 1.5 * LAP, False)):
        log.write("/plan/clock", time, {"delay": WAITED, "goes_on": goes_on})
    log.write("/explorer", 0.0, foxglove_messages.log(0.0, "CALIBRATE", "power on"))
    log.write("/explorer", 0.5, foxglove_messages.log(0.5, "TAKE_OFF", "level: taking off"))


def estimator_sigmas(time):
    """Standard deviations of attitude, position and velocity: with a gap from 4 to 5 s, (9,)."""
    since = np.clip(time - 4.0, 0.0, 1.0) if time < 5.0 else 0.0
    return np.repeat([np.deg2rad(0.2), 0.03 + 0.4 * since**2, 0.05 + 0.5 * since], 3)


def write_estimator(log, laps):
    """Writes what an estimator that knows its own errors says of them to a RaceLog."""
    rng = np.random.default_rng(0)
    sample = np.zeros((10, 7))
    for time in np.arange(0.02, FIRST + laps * LAP, 0.02).tolist():
        sample[:, 0] = time - 0.002 * np.arange(10)
        sample[:, 6] = time
        log.write("/imu/samples", time, json_topics.imu_samples_data(sample[::-1]))
    for time in np.arange(0.0, FIRST + laps * LAP, 1 / 30).tolist():
        p, v, q = flight(time)
        sigmas = estimator_sigmas(time)
        covariance = np.diag([*sigmas**2, *[1e-6] * 3, *[1e-4] * 3])
        navigation = np.array([time, *q, *p, *v, 0.01, 0.0, -0.01, 0.1, 0.0, -0.1])
        blind = 4.0 < time < 5.0
        squared = () if blind else ((0, rng.chisquare(8)), (2, rng.chisquare(8)))
        landmark = Landmark(0, seen_at=4.0 if blind else time)
        state = SlamState(
            belief=Belief(navigation, np.zeros((0, 5)), covariance),
            landmarks=(landmark,),
            innovations=squared,
        )
        error = sigmas * rng.standard_normal(9)
        log.write("/estimator", time, json_topics.estimator_data(state, error))


def make_run(folder, laps=2, finished=True, recorded=True, closed=True, **fields):
    """Writes the run into a folder that it creates; returns the folder."""
    folder.mkdir(parents=True)
    scenario = Scenario(laps=laps, **fields)
    if not recorded:
        scenario.recording.content = "none"
    (folder / "scenario.yaml").write_text(scenario_yaml(scenario))
    (folder / "race.json").write_text(json.dumps(race_json(laps, finished)))
    if recorded:
        log = RaceLog(folder / FILE)
        write_log(log, laps, len(load_vehicle(scenario.drone)[0].rotors))
        if scenario.estimator == VIO:
            write_estimator(log, laps)
        log.flush()
        so_far = (folder / FILE).read_bytes()
        log.close()
        if not closed:  # as if the process had been killed before
            (folder / FILE).write_bytes(so_far)
    return folder
