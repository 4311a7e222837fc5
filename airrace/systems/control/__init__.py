"""From a reference and a state estimate to rotor speeds.

GeometricController is the controller; the others estimate, monitor, or take over.
"""
