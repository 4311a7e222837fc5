"""What crosses the link in HITL: the one table that both bridges are built from."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from drake import lcmt_image_array
from pydrake.common.value import Value
from pydrake.systems.sensors import ImageGrey8U, ImageRgba8U

from airrace import lcmtypes
from airrace.hitl.link import image_messages, messages, plan_messages
from airrace.hitl.link.endpoint import Channel
from airrace.hitl.link.packets import MALFORMED, Dropped
from airrace.scenario import Scenario
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.referee_status import RefereeStatus
from airrace.systems.types import ExplorerStatus
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE

SIMULATION, AUTONOMY = "simulation", "autonomy"
_IMAGES = {"camera_grey": ImageGrey8U, "camera_image": ImageRgba8U}  # C++ values
_SMALL, _LARGE = 64 << 10, 4 << 20  # bytes, of one message at most


@dc.dataclass(frozen=True)
class Row:
    """One channel.

    Attributes:
        ports: that cross on it: output ports of the sender's diagram, and input
            ports of the other one's.
        channel: the LCM channel.
        message_type: of airrace.lcmtypes or Drake's.
        sender: SIMULATION or AUTONOMY.
        rate: how often the ports' values change (Hz), which is how often they are
            sent; in lockstep, at every change.
        encode: from the values of the ports, as keywords, and ``lossless``, to a message.
        decode: from a message to the values, a dict by port; raises Dropped.
        initial: dict of the values before the first message; an array says that a
            port is a vector.
        repeat: a value that does not change is sent again after so long (s), for
            whoever did not hear it.
        timed: whether a value that comes before the time of its stamp waits for it.
    """

    ports: tuple
    channel: str
    message_type: type
    sender: str
    rate: float
    encode: Callable
    decode: Callable
    initial: dict
    repeat: float = 0.5
    timed: bool = False
    max_size: int = _SMALL

    def model(self, port: str):
        """Returns the size of a port that is a vector, else a Value of its type."""
        initial = self.initial[port]
        if isinstance(initial, np.ndarray):
            return initial.size
        if port in _IMAGES:
            return Value(_IMAGES[port]())
        return Value[object]() if initial is None else Value[object](initial)

    def as_channel(self) -> Channel:
        """Returns what an Endpoint must know of it."""
        return Channel(
            self.channel, self.message_type, self.sender, self.decode, self.max_size, self.timed
        )


# The ports of pictures, and which picture each shows.
PICTURES = {
    "camera_view": image_messages.GREY,
    "camera_grey": image_messages.GREY,
    "camera_image": image_messages.COLOUR,
}


def make_channels(scenario: Scenario, wanted=("camera_view",)) -> tuple[Row, ...]:
    """Returns the rows of a scenario's race.

    ``truth.referee_status`` is for spectators on the network: the autonomy does not listen.

    Args:
        scenario: the race.
        wanted: which ports of PICTURES the autonomy's systems look at.
    """
    n = len(load_vehicle(scenario.drone)[0].rotors)
    zeros = np.zeros
    return (
        _camera(scenario, wanted),
        _row(
            "camera_info",
            "CAMERA_INFO",
            lcmtypes.lcmt_camera_info,
            SIMULATION,
            1.0,
            messages.encode_camera_info,
            messages.decode_camera_info,
            None,
        ),
        _row(
            "state_estimate",
            "STATE_ESTIMATE",
            lcmtypes.lcmt_state_estimate,
            SIMULATION,
            scenario.state_estimate.rate,
            messages.encode_state_estimate,
            messages.decode_state_estimate,
            zeros(STATE_SIZE),
        ),
        _rotors(scenario, n),
        _row(
            "truth.referee_status",
            "REFEREE_REPORT",
            lcmtypes.lcmt_referee_status,
            SIMULATION,
            10.0,
            messages.encode_referee_status,
            messages.decode_referee_status,
            RefereeStatus((), False, None, None, 0),
        ),
        _row(
            "rotor_speed_command",
            "ROTOR_SPEED_COMMAND",
            lcmtypes.lcmt_rotors,
            AUTONOMY,
            scenario.controller.rate,
            messages.encode_rotors,
            _sized(messages.decode_rotors, n),
            zeros(n),
            repeat=0.02,
            timed=True,
        ),
        _row(
            "rotor_losses",
            "ROTOR_LOSSES",
            lcmtypes.lcmt_rotors,
            AUTONOMY,
            10.0,
            messages.encode_rotors,
            _sized(messages.decode_rotor_losses, n),
            np.full(n, np.inf),
        ),
        _row(
            "explorer_status",
            "EXPLORER_STATUS",
            lcmtypes.lcmt_explorer_status,
            AUTONOMY,
            scenario.explorer.rate,
            messages.encode_explorer_status,
            messages.decode_explorer_status,
            ExplorerStatus(),
            max_size=_LARGE,
        ),
        _row(
            "gate_map",
            "GATE_MAP",
            lcmtypes.lcmt_gate_map,
            AUTONOMY,
            10.0,
            messages.encode_gate_map,
            messages.decode_gate_map,
            GateMap(),
            max_size=_LARGE,
        ),
        _row(
            "lap_plan",
            "LAP_PLAN",
            lcmtypes.lcmt_lap_plan,
            AUTONOMY,
            scenario.planner.rate,
            plan_messages.encode_lap_plan,
            plan_messages.decode_lap_plan,
            NO_PLAN,
            max_size=_LARGE,
        ),
    )


def _row(port, name, message_type, sender, rate, encode, decode, initial, **others) -> Row:
    return Row(
        (port,),
        f"AIRRACE_{name}",
        message_type,
        sender,
        rate,
        lambda lossless, **values: encode(values[port]),
        lambda message: {port: decode(message)},
        {port: initial},
        **others,
    )


def _sized(decode, n):
    def decode_n(message):
        if message.count != n:
            raise Dropped(MALFORMED)
        return decode(message)

    return decode_n


def _rotors(scenario: Scenario, n: int) -> Row:
    """Returns the row of what the motor controllers of n rotors report."""
    # The report first: its time tells that it is a new one.
    return Row(
        ("rotor_status", "rotor_speeds"),
        "AIRRACE_ROTOR_REPORT",
        lcmtypes.lcmt_rotor_status,
        SIMULATION,
        scenario.rotors.rate,
        lambda lossless, **values: messages.encode_rotor_status(**values),
        _sized(messages.decode_rotor_status, n),
        {"rotor_status": np.zeros(1 + 2 * n), "rotor_speeds": np.zeros(n)},
    )


def _camera(scenario: Scenario, wanted) -> Row:
    """Returns the row of the pictures."""
    shape = (scenario.camera.height, scenario.camera.width)
    make = {
        "camera_view": image_messages.view_of,
        "camera_grey": image_messages.grey_of,
        "camera_image": image_messages.rgba_of,
    }
    get = {
        "camera_view": lambda view: view.whole(),
        "camera_grey": lambda image: image.data[..., 0],
        "camera_image": lambda image: image.data,
    }

    def encode(lossless, camera_image_time, **images):
        found = {PICTURES[port]: get[port](image) for port, image in images.items()}
        return image_messages.encode_pictures(found, float(camera_image_time[0]), lossless)

    def decode(message):
        found, time = image_messages.decode_pictures(message)
        values = {port: make[port](found, shape) for port in wanted}
        return {"camera_image_time": messages.read_only([time]), **values}

    # The time first: it tells whether there is a new picture, before that is drawn.
    return Row(
        ("camera_image_time", *wanted),
        "AIRRACE_CAMERA",
        lcmt_image_array,
        SIMULATION,
        scenario.camera.fps,
        encode,
        decode,
        {"camera_image_time": np.full(1, -1.0), **dict.fromkeys(wanted)},
        max_size=_LARGE,
    )
