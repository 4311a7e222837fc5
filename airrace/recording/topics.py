"""The topics of race.mcap, and what each carries.

Those whose schema is one of Foxglove's are shown by its panels as they are. The
others are JSON, with schemas of ours in json_topics.py.
"""

from foxglove import channels as fg

from airrace.recording import json_topics

TOPICS = {
    "/scene": fg.SceneUpdateChannel,  # pylons and boards where they truly stand; the drone
    "/tf": fg.FrameTransformsChannel,  # world to body (truth), body to camera
    "/state/truth": fg.OdometryChannel,
    "/state/estimate": fg.OdometryChannel,  # as the autopilot hands it to the autonomy
    "/state/filtered": fg.OdometryChannel,  # as the controller uses it
    "/state/disturbance": fg.Vector3Channel,  # m/s^2 in world, as the filter finds it
    "/path": fg.SceneUpdateChannel,  # the last seconds' way, coloured by speed
    "/reference": fg.OdometryChannel,  # position, yaw and their rates
    "/reference/acceleration": fg.Vector3Channel,  # m/s^2 in world
    "/rotors/measured": fg.JointStatesChannel,  # rad/s; effort: nominal thrust (N)
    "/rotors/command": fg.JointStatesChannel,
    "/camera/image": fg.CompressedImageChannel,
    "/camera/calibration": fg.CameraCalibrationChannel,
    "/camera/annotations": fg.ImageAnnotationsChannel,
    "/detections": json_topics.DETECTIONS,
    "/detections/rays": fg.SceneUpdateChannel,
    "/map": json_topics.MAP,
    "/map/scene": fg.SceneUpdateChannel,
    "/plan": json_topics.PLAN,
    "/plan/scene": fg.SceneUpdateChannel,
    "/explorer": fg.LogChannel,
    "/referee": fg.LogChannel,
    "/referee/crossings": json_topics.CROSSING,
}
WORLD, BODY, CAMERA = "world", "body", "camera"  # frames
