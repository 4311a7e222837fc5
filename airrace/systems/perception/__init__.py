"""From a picture to markers with poses.

ArucoDetector searches, refits corners, solves poses and checks them.
"""
