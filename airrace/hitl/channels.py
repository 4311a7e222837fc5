"""What crosses the link in HITL: the one table that both bridges are built from."""

import dataclasses as dc
import math
from collections.abc import Callable, Collection, Iterable
from itertools import starmap
from typing import TYPE_CHECKING, Any

import numpy as np

from airrace.common.immutable import read_only
from airrace.diagrams.variants import variant_of
from airrace.hitl.link import image_messages, messages
from airrace.hitl.link.endpoint import AUTONOMY, SIMULATION, Channel
from airrace.hitl.link.packets import MALFORMED, Dropped
from airrace.hitl.link.plan_messages import LAP_PLAN
from airrace.lcmtypes import lcmt_pictures
from airrace.scenario import Scenario
from airrace.systems.estimation.navigation import NAVIGATION_SIZE
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.policy.policy_controller import PERIOD as POLICY_PERIOD
from airrace.systems.sensing.imu_samples import IMU_DEPTH, NO_SAMPLES
from airrace.systems.sensing.picture_ports import PICTURE_PORTS
from airrace.systems.types import ExplorerStatus, PolicyStatus, RefereeStatus
from airrace.track.gate_map import GateMap
from airrace.vehicle import load_vehicle
from airrace.vehicle.state import STATE_SIZE

if TYPE_CHECKING:
    from airrace.hitl.link.codec import Codec

# Of the simulation, which not every autonomy needs; the others always cross the link.
OPTIONAL_PORTS = (*PICTURE_PORTS, "state_estimate", "imu")
_ALWAYS = ("camera_info", "truth.referee_status")  # of the simulation
_BYTES, _REST = 5, 4096  # of pixels in grey and in colour, and what else is in a message
_UNKNOWN = np.array([-1.0, 1.0, *[0.0] * (NAVIGATION_SIZE - 2)])  # before the first correction


@dc.dataclass(frozen=True, kw_only=True)
class PortChannel(Channel):
    """A channel that carries the values of ports."""

    # Output ports of the sender's diagram, and input ports of the other one's; whether the value of
    # the first is another tells whether there is a new message
    ports: tuple
    # How often the ports' values change (Hz), which is how often they are sent; in lockstep, at
    # every change
    rate: float
    # From the values of the ports, as keywords, and ``lossless``, to a message. ``decode`` returns
    # a dict by port.
    encode: Callable
    # Dict of the values before the first message; an array says that a port is a vector
    initial: dict
    # A value that does not change is sent again after so long (s), since messages get lost
    repeat: float = 0.5


def make_channels(
    scenario: Scenario, wanted: Collection[str] = ("camera_view", "state_estimate")
) -> tuple[PortChannel, ...]:
    """Returns the channels of a scenario's race.

    ``truth.referee_status`` is for spectators on the network: the autonomy does not listen.

    Args: wanted: which ports of OPTIONAL_PORTS the autonomy's systems use.
    """
    n = len(load_vehicle(scenario.drone)[0].rotors)
    nothing = RefereeStatus((), False, None, None, 0)
    command = {"repeat": 0.02, "timed": True}
    estimates, commands = scenario.state_estimate.rate, scenario.controller.rate
    events = scenario.explorer.rate
    # Each message of the IMU has as many new samples as old ones, so that one may get lost.
    imu = 2 * scenario.imu.rate / IMU_DEPTH
    table = (
        # Port, sender, Codec, initial value, rate (Hz), options.
        ("camera_info", SIMULATION, messages.CAMERA_INFO, None, 1.0),
        ("state_estimate", SIMULATION, messages.STATE_ESTIMATE, np.zeros(STATE_SIZE), estimates),
        ("imu", SIMULATION, messages.IMU, NO_SAMPLES, imu),
        ("truth.referee_status", SIMULATION, messages.REFEREE_STATUS, nothing, 10.0),
        ("rotor_speed_command", AUTONOMY, messages.ROTORS, np.zeros(n), commands, command),
        ("rotor_losses", AUTONOMY, messages.ROTOR_LOSSES, np.full(n, np.inf), 10.0),
        ("explorer_status", AUTONOMY, messages.EXPLORER_STATUS, ExplorerStatus(), events),
        ("gate_map", AUTONOMY, messages.GATE_MAP, GateMap(), 10.0),
        ("lap_plan", AUTONOMY, LAP_PLAN, NO_PLAN, scenario.planner.rate),
        # The flight controller has an estimator of its own, where the drone has to have one.
        ("corrections", AUTONOMY, messages.NAVIGATION, _UNKNOWN, scenario.camera.fps),
        ("policy_status", AUTONOMY, messages.POLICY_STATUS, PolicyStatus(), 1.0 / POLICY_PERIOD),
    )
    made = variant_of(scenario).outputs.keys() - OPTIONAL_PORTS
    crossing = {*_ALWAYS, *made, *wanted}
    rows = [row for row in table if row[0] in crossing]
    pictures = [port for port in wanted if port in PICTURE_PORTS]
    return (_camera(scenario, pictures), _rotor_status(scenario, n), *starmap(_channel, rows))


def channel_name(port: str) -> str:
    """Returns the name of the channel that carries a port alone."""
    return f"AIRRACE_{port.removeprefix('truth.').upper()}"


def _channel(
    port: str,
    sender: str,
    codec: "Codec",
    initial: Any,
    rate: float,
    options: Iterable[tuple[str, Any]] = (),
) -> PortChannel:
    def decode(message):
        value = codec.decode(message)
        if isinstance(initial, np.ndarray) and value.shape != initial.shape:
            raise Dropped(MALFORMED)
        return {port: value}

    return PortChannel(
        name=channel_name(port),
        message_type=codec.message_type,
        sender=sender,
        decode=decode,
        ports=(port,),
        rate=rate,
        encode=lambda lossless, **values: codec.encode(values[port]),
        initial={port: initial},
        **dict(options),
    )


def _rotor_status(scenario: Scenario, n: int) -> PortChannel:
    """Returns the channel of what the motor controllers of n rotors measure.

    The status has a time, which changes; the speeds, a port of their own, are in it.
    """
    codec, rate = messages.ROTOR_STATUS, scenario.rotors.rate
    channel = _channel("rotor_status", SIMULATION, codec, np.zeros(1 + 2 * n), rate)

    def decode(message):
        values = channel.decode(message)
        return {**values, "rotor_speeds": values["rotor_status"][1 : 1 + n]}

    initial = {**channel.initial, "rotor_speeds": np.zeros(n)}
    return dc.replace(channel, ports=tuple(initial), decode=decode, initial=initial)


def _camera(scenario: Scenario, wanted: Iterable[str]) -> PortChannel:
    """Returns the channel of the pictures."""
    shape = (scenario.camera.height, scenario.camera.width)

    def encode(lossless, camera_image_time, **images):
        pictures = {
            PICTURE_PORTS[port].picture: PICTURE_PORTS[port].pixels_of(image)
            for port, image in images.items()
        }
        return image_messages.encode_pictures(pictures, float(camera_image_time[0]), lossless)

    def decode(message):
        pictures, time = image_messages.decode_pictures(message, shape)
        values = {port: image_messages.port_value(port, pictures, shape) for port in wanted}
        return {"camera_image_time": read_only([time]), **values}

    return PortChannel(
        name="AIRRACE_CAMERA",
        message_type=lcmt_pictures,
        sender=SIMULATION,
        decode=decode,
        ports=("camera_image_time", *wanted),  # the time first: no picture is drawn for it
        rate=scenario.camera.fps,
        encode=encode,
        initial={"camera_image_time": np.full(1, -1.0), **dict.fromkeys(wanted)},
        max_size=_BYTES * math.prod(shape) + _REST,
        most_waiting=8,
        newest_wins=True,
    )
