"""The speed of one drone without a camera, beside that of other simulators."""
