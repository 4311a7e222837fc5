"""The drone as data: mass, inertia, rotors, its motion, and what its rotors can do together.

A drone of your own is a folder with a vehicle.yaml.
"""

from airrace.vehicle.allocation import Allocator, wrench_margin
from airrace.vehicle.rotor_loss import Remaining
from airrace.vehicle.rotors import RotorDynamics, RotorStatus, as_rotor_status, make_rotor_dynamics
from airrace.vehicle.state import STATE_SIZE, State, as_plant_state, as_state, state_vector
from airrace.vehicle.vehicle import (
    DRONES,
    GRAVITY,
    GRAVITY_W,
    RACERS,
    CameraMount,
    Drag,
    Gains,
    ImuMount,
    OriginalGains,
    Rotor,
    Vehicle,
    find_vehicle,
    load_vehicle,
)
