"""From a picture to markers with poses.

ArucoDetector is the system; detect() beside it calls search, refit, checks and poses in turn.
"""
