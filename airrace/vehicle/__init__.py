"""The drone as data: mass, inertia, rotors, and what they can do together.

A drone of your own is a folder with a vehicle.yaml.
"""

from airrace.vehicle.vehicle import (
    DRONES,
    GRAVITY,
    CameraMount,
    Drag,
    Rotor,
    Vehicle,
    find_vehicle,
    load_vehicle,
)
