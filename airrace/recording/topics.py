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


def _truth(time, vector, vehicle):
    return messages.odometry(as_plant_state(vector, time))


def _estimate(time, vector, vehicle):
    return messages.odometry(as_state(vector))


def _reference(time, vector, vehicle):
    return messages.reference_odometry(time, as_reference(vector))


def _acceleration(time, vector, vehicle):
    return messages.vector3(as_reference(vector).acceleration)


def _vector3(time, vector, vehicle):
    return messages.vector3(vector)


def _rotors(time, speeds, vehicle):
    return messages.rotors(time, speeds, vehicle.thrust_coefficients)


TOPICS = {
    "/state/truth": Topic(fg.OdometryChannel, STATE, "truth.state", _truth),
    # As the autopilot hands it to the autonomy, as the controller uses it, and the
    # acceleration that it finds (m/s^2 in world).
    "/state/estimate": Topic(fg.OdometryChannel, STATE, "state_estimate", _estimate),
    "/state/filtered": Topic(fg.OdometryChannel, STATE, "filtered_estimate", _estimate),
    "/state/disturbance": Topic(fg.Vector3Channel, STATE, "disturbance", _vector3),
    # Position, yaw and their rates; m/s^2 in world.
    "/reference": Topic(fg.OdometryChannel, STATE, "reference", _reference),
    "/reference/acceleration": Topic(fg.Vector3Channel, STATE, "reference", _acceleration),
    # rad/s; effort: nominal thrust (N).
    "/rotors/measured": Topic(fg.JointStatesChannel, STATE, "rotor_speeds", _rotors),
    "/rotors/command": Topic(fg.JointStatesChannel, STATE, "rotor_speed_command", _rotors),
    # From world to body (truth), and from body to camera.
    "/tf": Topic(fg.FrameTransformsChannel, POSE, "truth.state"),
    # What was flown in the last seconds, coloured by speed.
    "/path": Topic(fg.SceneUpdateChannel, SECOND, "truth.state"),
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
