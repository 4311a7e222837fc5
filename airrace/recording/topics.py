"""The topics of race.mcap: what each carries, when it is written, and from where.

Foxglove's panels show those with one of its channels as they are. The others are JSON, with
schemas of ours.
"""

from collections.abc import Callable
from typing import NamedTuple

from foxglove import channels as fg

from airrace.recording import foxglove_messages as messages
from airrace.recording import json_topics
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import as_plant_state, as_state

# When a topic is written: at a rate of RecordingConfig (Hz), ...
STATE, POSE, IMAGE = "state_rate", "pose_rate", "image_rate"
# ... once a second, or when the port has a new value, polled at the camera's rate.
SECOND, CHANGE = "every second", "when it changes"


class Topic(NamedTuple):
    """A topic.

    Attributes:
        channel: class of Foxglove's channel, or a JSON schema.
        when: one of those above.
        port: of RaceRecorder, whose value the topic carries.
        encode: of STATE, makes the message of the time (s), the port's vector and the
            Vehicle; RaceRecorder makes the others.
    """

    channel: type | dict
    when: str
    port: str
    encode: Callable | None = None


def _estimate(port: str) -> Topic:
    return Topic(
        fg.OdometryChannel, STATE, port, lambda _, x, vehicle: messages.odometry(as_state(x))
    )


def _rotors(port: str) -> Topic:
    return Topic(
        fg.JointStatesChannel,
        STATE,
        port,
        lambda time, w, vehicle: messages.rotors(time, w, vehicle.thrust_coefficients),
    )


TOPICS = {
    "/state/truth": Topic(
        fg.OdometryChannel,
        STATE,
        "truth.state",
        lambda time, x, vehicle: messages.odometry(as_plant_state(x, time)),
    ),
    "/state/estimate": _estimate("state_estimate"),  # as the autopilot hands it to the autonomy
    "/state/filtered": _estimate("filtered_estimate"),  # as the controller uses it
    "/state/disturbance": Topic(  # m/s^2 in world, as the filter finds it
        fg.Vector3Channel, STATE, "disturbance", lambda time, a, vehicle: messages.vector3(a)
    ),
    "/reference": Topic(  # position, yaw and their rates
        fg.OdometryChannel,
        STATE,
        "reference",
        lambda time, r, vehicle: messages.reference_odometry(time, as_reference(r)),
    ),
    "/reference/acceleration": Topic(  # m/s^2 in world
        fg.Vector3Channel,
        STATE,
        "reference",
        lambda time, r, vehicle: messages.vector3(as_reference(r).acceleration),
    ),
    "/rotors/measured": _rotors("rotor_speeds"),  # rad/s; effort: nominal thrust (N)
    "/rotors/command": _rotors("rotor_speed_command"),
    "/tf": Topic(fg.FrameTransformsChannel, POSE, "truth.state"),  # world to body to camera
    "/path": Topic(fg.SceneUpdateChannel, SECOND, "truth.state"),  # flown, coloured by speed
    # Pylons and boards where they truly stand; the drone.
    "/scene": Topic(fg.SceneUpdateChannel, CHANGE, "truth.gate_shifts"),
    "/camera/image": Topic(fg.CompressedImageChannel, IMAGE, "camera_view"),
    "/camera/calibration": Topic(fg.CameraCalibrationChannel, IMAGE, "camera_info"),
    "/camera/annotations": Topic(fg.ImageAnnotationsChannel, IMAGE, "detections"),
    "/detections": Topic(json_topics.DETECTIONS, CHANGE, "detections"),
    "/detections/rays": Topic(fg.SceneUpdateChannel, CHANGE, "detections"),
    # At most once a second, and when a lap has ended.
    "/map": Topic(json_topics.MAP, CHANGE, "gate_map"),
    "/map/scene": Topic(fg.SceneUpdateChannel, CHANGE, "gate_map"),
    "/plan": Topic(json_topics.PLAN, CHANGE, "lap_plan"),
    "/plan/scene": Topic(fg.SceneUpdateChannel, CHANGE, "lap_plan"),
    "/explorer": Topic(fg.LogChannel, CHANGE, "explorer_status"),
    "/referee": Topic(fg.LogChannel, CHANGE, "truth.referee_status"),
    "/referee/crossings": Topic(json_topics.CROSSING, CHANGE, "truth.referee_status"),
}
