"""From a picture to markers. It flies as it is."""

from airrace.systems.perception.aruco_detector import ArucoDetector


class MyDetector(ArucoDetector):
    """The shipped detector, to begin with.

    A detector from scratch is a LeafSystem with these ports; `airrace new detector NAME` makes one.

    .. pydrake_system::

        name: MyDetector
        input_ports:
        - camera_view
        - camera_image_time
        - camera_info
        output_ports:
        - detections
    """


def make(scenario):
    """Returns the system; called once before a race."""
    return MyDetector.from_scenario(scenario)
