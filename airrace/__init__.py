"""airrace: autonomous drone racing on Drake, without ROS."""

__version__ = "0.1.0"
