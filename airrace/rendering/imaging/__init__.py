"""From ideal pictures to a camera's: shutter, lens and sensor.

camera_effects.py puts them in a row; a scenario chooses how good the camera is.
"""
