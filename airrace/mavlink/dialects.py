"""The two dialects of the interface, as data: what numbers on the wire mean.

``official`` is how the clients of the AI Grand Prix know their simulator, ``none`` is clean NED and
FRD, as MAVLink defines them. No other file knows that there are two: all read values from a
Dialect. docs/grand_prix.md prints its table from the fields below.
"""

import dataclasses as dc
from collections.abc import Mapping
from typing import Any, NamedTuple

from airrace.scenario.mavlink_config import NONE, OFFICIAL
from airrace.track.square_gate import INNER, OUTER

# Who says so of the official dialect.
SPECIFICATION = "specification"  # VADR-TS-003, issue 00.03
CAPTURED = "captured"  # packets and flights that entrants recorded on the official simulator
CLIENTS = "clients"  # what several published clients do, and fly with
ONE = "one client"  # what only one source says
OURS = "ours"  # nobody says it: chosen to fit the rest
LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED, BODY_FRD = 1, 7, 8, 9, 12

type Three = tuple[float, float, float]
type Four = tuple[float, float, float, float]


class Frame(NamedTuple):
    """What a coordinate_frame of SET_POSITION_TARGET_LOCAL_NED means."""

    #: whether positions begin where the drone is when the set-point comes, or LOCAL_NED does
    offset: bool
    heading: bool  #: whether x looks where the drone's nose does, level, and not to the north


def _fact(what: str, says: str) -> Any:
    return dc.field(metadata={"what": what, "says": says})


@dc.dataclass(frozen=True, kw_only=True)
class Dialect:
    """What numbers on the wire mean. Signs are factors on numbers of NED and FRD."""

    attitude: Three = _fact("`ATTITUDE`: signs of roll, pitch, yaw", CAPTURED)
    attitude_rates: Three = _fact("`ATTITUDE`: signs of their rates, as the gyroscope's", OURS)
    odometry_quaternion: Four = _fact(
        "`ODOMETRY`: signs of w, x, y, z, which turn its velocity to NED's", CAPTURED
    )
    odometry_child: int = _fact("`ODOMETRY`: child_frame_id", ONE)
    odometry_rates: Three = _fact("`ODOMETRY`: signs of its rates, as the gyroscope's", CAPTURED)
    gyro: Three = _fact("`HIGHRES_IMU`: signs of the gyroscope", CAPTURED)
    epoch_ns: int = _fact("pictures and `TIMESYNC`'s tc1: time of the boot (ns)", CAPTURED)
    base_mode: int = _fact("`HEARTBEAT`: base_mode, with 128 more while it is armed", CAPTURED)
    active_status: int = _fact("`HEARTBEAT`: system_status while it is armed, 3 before", CAPTURED)
    motors: tuple[tuple[int, int], ...] = _fact(
        "order of the motors: forward or back, left or right", CAPTURED
    )
    gate_point: Three = _fact(
        "the track: a gate's place, from the middle of its opening: forward, left, up (m)", CAPTURED
    )
    gate_axes: Four = _fact(
        "the track: a gate's axes, as a quaternion from forward, left, up: along its width, "
        "normal, down; or normal, right, down",
        CAPTURED,
    )
    gate_side: float = _fact("the track: width and height of a gate (m)", CAPTURED)
    track_at: float = _fact("the track is sent at (s)", CAPTURED)
    track_period: float = _fact("and again each (s), 0 = once to each client", CAPTURED)
    loading: float = _fact("the countdown begins with arming, not before (s)", CAPTURED)
    starts_itself: bool = _fact("or then, if the client has said anything", CLIENTS)
    settling: float = _fact("or after a reset, not before (s)", CLIENTS)
    clock_goes_on: bool = _fact("a reset leaves the clock since boot as it is", ONE)
    countdown: float = _fact("from then to the race's start (s)", CAPTURED)
    early: float = _fact(
        "a drone so far off its pad before the start is disqualified (m), 0 = never", OURS
    )
    setpoint_quaternion: Four = _fact("`SET_ATTITUDE_TARGET`: signs of w, x, y, z", CLIENTS)
    stick_gains: Three = _fact(
        "`SET_ATTITUDE_TARGET`: rad/s flown for 1 of a body rate that is small", CAPTURED
    )
    stick_growth: Three = _fact(
        "and of a rate w, the gain is divided by 1 - growth min(abs(w), pi) / pi", ONE
    )
    rate_gains: Three = _fact(
        "the same if bit 16 of its type_mask is set; less than 0 = mirrored", CAPTURED
    )
    thrust: tuple[tuple[float, float], ...] | None = _fact(
        "`SET_ATTITUDE_TARGET`: thrusts, and the m/s² of each; null = a share of all thrust",
        CAPTURED,
    )
    velocity_to_position: float = _fact(
        "`SET_POSITION_TARGET_LOCAL_NED`: share of a velocity that counts beside a position",
        CLIENTS,
    )
    frames: Mapping[int, Frame] = _fact(
        "and its coordinate_frames: whether they begin at the drone, and follow its nose", CLIENTS
    )
    other_frame: Frame | None = _fact("and other frames; null = denied", CLIENTS)
    port: int = _fact("port that MAVLink is sent from, and heard at", CAPTURED)
    picture_port: int = _fact("port that pictures are sent from", CAPTURED)
    fixed_port: bool = _fact("MAVLink goes to one port only, wherever an answer is from", CAPTURED)
    picture_copies: int = _fact("each datagram of a picture comes so often", CAPTURED)
    jpeg_size: int = _fact("a smaller JPEG is filled up to (bytes)", CAPTURED)


_PLAIN: Three = (1.0, 1.0, 1.0)
_MIRRORED: Three = (-1.0, -1.0, -1.0)
_LOCAL = Frame(offset=False, heading=False)
_DIAGONAL = 0.5**0.5

# Specific force (m/s^2) by thrust, from 40,000 samples of 13 flights of one entrant; at 0.266 it
# hovers and grows by 53.5 for 1 more, as others measured. Two more found it convex, and a fourth
# climbed as fast as it says.
_THRUST = (
    (0.0, 0.0), (0.05, 0.8), (0.1, 2.3), (0.15, 4.2), (0.2, 6.3), (0.266, 9.81), (0.31, 12.15),
    (0.36, 14.8), (0.41, 18.3), (0.46, 22.4), (0.51, 26.6), (0.56, 30.6), (0.61, 34.8),
    (0.66, 38.5), (0.72, 42.7), (0.82, 46.9), (1.0, 51.7),
)  # fmt: skip

DIALECTS = {
    OFFICIAL: Dialect(
        attitude=(1.0, -1.0, -1.0),
        attitude_rates=_MIRRORED,
        odometry_quaternion=(1.0, -1.0, 1.0, -1.0),
        odometry_child=BODY_NED,
        odometry_rates=_MIRRORED,
        gyro=_MIRRORED,
        epoch_ns=1_782_259_200_000_000_000,  # 2026-06-24, so that a race is the same each time
        base_mode=65,
        active_status=3,
        motors=((1, 1), (1, -1), (-1, 1), (-1, -1)),  # FL, FR, BL, BR
        gate_point=(0.0, 0.0, -OUTER / 2),
        gate_axes=(0.0, _DIAGONAL, _DIAGONAL, 0.0),
        gate_side=OUTER,
        track_at=9.5,
        track_period=0.0,
        loading=10.65,
        starts_itself=True,
        settling=3.5,
        clock_goes_on=True,
        countdown=2.85,
        early=0.1,
        setpoint_quaternion=(1.0, 1.0, -1.0, -1.0),
        stick_gains=(2.359, 2.363, 2.163),
        stick_growth=(0.296, 0.284, 0.316),
        rate_gains=(-0.98, -0.98, -0.89),
        thrust=_THRUST,
        velocity_to_position=0.0,
        frames={},
        other_frame=_LOCAL,
        port=14560,
        picture_port=5601,
        fixed_port=True,
        picture_copies=2,
        jpeg_size=68_000,
    ),
    NONE: Dialect(
        attitude=_PLAIN,
        attitude_rates=_PLAIN,
        odometry_quaternion=(1.0, 1.0, 1.0, 1.0),
        odometry_child=BODY_FRD,
        odometry_rates=_PLAIN,
        gyro=_PLAIN,
        epoch_ns=0,
        base_mode=17,
        active_status=4,
        motors=((1, -1), (-1, 1), (1, 1), (-1, -1)),  # FR, RL, FL, RR, as PX4's
        gate_point=(0.0, 0.0, 0.0),
        gate_axes=(0.0, 1.0, 0.0, 0.0),
        gate_side=INNER,
        track_at=0.0,
        track_period=1.0,
        loading=0.0,
        starts_itself=False,
        settling=0.0,
        clock_goes_on=False,
        countdown=0.0,
        early=0.0,
        setpoint_quaternion=(1.0, 1.0, 1.0, 1.0),
        stick_gains=_PLAIN,
        stick_growth=(0.0, 0.0, 0.0),
        rate_gains=_PLAIN,
        thrust=None,
        velocity_to_position=1.0,
        frames={
            LOCAL_NED: _LOCAL,
            LOCAL_OFFSET_NED: Frame(offset=True, heading=False),
            BODY_NED: Frame(offset=True, heading=True),
            BODY_OFFSET_NED: Frame(offset=True, heading=True),
            BODY_FRD: Frame(offset=True, heading=True),
        },
        other_frame=None,
        port=14560,
        picture_port=5601,
        fixed_port=False,
        picture_copies=1,
        jpeg_size=0,
    ),
}
