"""The topics of race.mcap: what each carries, and when it is written.

Foxglove's panels show those with one of its channels as they are. The others are JSON, with
schemas of ours.
"""

import logging
from typing import Any

import foxglove
from foxglove import channels as fg

from airrace.recording import foxglove_messages as messages
from airrace.recording import json_topics


def _silence_sdk() -> None:
    """Keeps the SDK from filling the terminal of a race: airrace says itself what fails.

    Only the first call counts, and it must come before there is a file or a server.
    """
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    foxglove.set_log_level(logging.CRITICAL)
    # It sets up the logging of the whole program, which is not its own.
    root.handlers, root.level = handlers, level


_silence_sdk()


def _state(time, state, vehicle):
    return messages.odometry(state)


def _vector3(time, vector, vehicle):
    return messages.vector3(vector)


def _reference(time, reference, vehicle):
    return messages.reference_odometry(time, reference)


def _acceleration(time, reference, vehicle):
    return messages.vector3(reference.acceleration)


def _rotors(time, speeds, vehicle):
    return messages.rotors(time, speeds, vehicle.thrust_coefficients)


def _imu(time, vector, vehicle):
    return json_topics.imu_data(vector)


# Written for every StateSample: class of Foxglove's channel, or a JSON schema, the field of the
# sample, and what makes the message of the time (s), the field and the Vehicle.
SAMPLED = {
    "/state/truth": (fg.OdometryChannel, "truth", _state),
    # As the autopilot hands it to the autonomy, as the controller uses it, and the
    # acceleration that it finds (m/s^2 in world).
    "/state/estimate": (fg.OdometryChannel, "estimate", _state),
    "/state/filtered": (fg.OdometryChannel, "filtered", _state),
    "/state/disturbance": (fg.Vector3Channel, "disturbance", _vector3),
    # The newest sample, where the drone has an IMU.
    "/imu": (json_topics.SCHEMAS["/imu"], "imu", _imu),
    # Position, yaw and their rates; m/s^2 in world.
    "/reference": (fg.OdometryChannel, "reference", _reference),
    "/reference/acceleration": (fg.Vector3Channel, "reference", _acceleration),
    # rad/s; effort: nominal thrust (N).
    "/rotors/measured": (fg.JointStatesChannel, "rotor_speeds", _rotors),
    "/rotors/command": (fg.JointStatesChannel, "rotor_commands", _rotors),
}
# Class of Foxglove's channel, or a JSON schema, of all topics.
TOPICS = {
    **{name: channel for name, (channel, *_) in SAMPLED.items()},
    # At pose_rate: from world to body (truth), and from body to camera.
    "/tf": fg.FrameTransformsChannel,
    # Once a second: what was flown in the last seconds, coloured by speed.
    "/path": fg.SceneUpdateChannel,
    # At image_rate, unless content is light.
    "/camera/image": fg.CompressedImageChannel,
    "/camera/calibration": fg.CameraCalibrationChannel,
    "/camera/annotations": fg.ImageAnnotationsChannel,
    # The others when they change. Pylons and boards where they truly stand, and the drone:
    "/scene": fg.SceneUpdateChannel,
    "/detections/rays": fg.SceneUpdateChannel,
    # This and /map at most once a second, and when a lap has ended.
    "/map/scene": fg.SceneUpdateChannel,
    "/plan/scene": fg.SceneUpdateChannel,
    "/explorer": fg.LogChannel,
    "/referee": fg.LogChannel,
    # What was found and refused, the map, the plan, how far the exploration is, and the gates that
    # counted:
    **json_topics.SCHEMAS,
}


def make_channels(context: foxglove.Context) -> dict[str, Any]:
    """Returns a channel for every topic, in a context of Foxglove's SDK."""
    return {
        name: foxglove.Channel(name, schema=channel, context=context)
        if isinstance(channel, dict)
        else channel(name, context=context)
        for name, channel in TOPICS.items()
    }
