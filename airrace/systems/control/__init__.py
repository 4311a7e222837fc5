"""From a reference, or what a client sets, to rotor speeds: laws, and the systems that apply them.

GeometricController flies references; VelocityController, AttitudeController and RateController are
a cascade, each of which hands on to the next.
"""
