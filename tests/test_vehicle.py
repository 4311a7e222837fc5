import dataclasses as dc
import math

import numpy as np
import pytest

from airrace.errors import UserError
from airrace.vehicle import load_vehicle


def test_allocation_is_equation_1():
    d, c = 0.3, 0.01
    expected = [
        [1, 1, 1, 1],
        [-d / 2, -d / 2, d / 2, d / 2],
        [d / 2, -d / 2, -d / 2, d / 2],
        [-c, c, -c, c],
    ]
    vehicle, _ = load_vehicle("Default")
    np.testing.assert_allclose(vehicle.allocation, expected, atol=1e-12)


def test_default_has_the_reference_limits():
    vehicle, sdf = load_vehicle("Default")
    assert sdf.is_file()
    np.testing.assert_allclose(vehicle.max_thrusts, 8.5)
    np.testing.assert_allclose(vehicle.thrust_coefficients * vehicle.max_speeds**2, 8.5)


def test_unknown_drone():
    with pytest.raises(UserError, match="Default"):
        load_vehicle("Fokker")


@pytest.mark.parametrize(
    "change, words",
    [
        (dict(mass=-1.0), "mass"),
        (dict(mass=math.nan), "mass"),
        (dict(mass=10.0), "cannot lift"),
        (dict(inertia=[0.01, math.nan, 0.01]), "inertia"),
        (dict(inertia=[0.01, 0.01, 0.03]), "triangle"),
        (dict(inertia=[0.01]), "inertia"),
        (dict(rotor_lag=0.0), "rotor_lag"),
        (dict(rotors=[]), "rotors"),
        (dict(camera_position=[0.0]), "camera_position"),
    ],
)
def test_impossible_vehicles(change, words):
    vehicle, _ = load_vehicle("Default")
    with pytest.raises(ValueError, match=words):
        dc.replace(vehicle, **change).check()


def test_rotors_that_cannot_yaw():
    vehicle, _ = load_vehicle("Default")
    in_line = [dc.replace(r, position=[0.1 * i, 0.0, 0.0]) for i, r in enumerate(vehicle.rotors)]
    with pytest.raises(ValueError, match="moments"):
        dc.replace(vehicle, rotors=in_line).check()
    with pytest.raises(ValueError, match="ccw or cw"):
        dc.replace(vehicle, rotors=[dc.replace(vehicle.rotors[0], direction="left")]).check()
