import dataclasses as dc
import math
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.vehicle import (
    DRONES,
    GRAVITY,
    RACERS,
    CameraMount,
    Drag,
    ImuMount,
    OriginalGains,
    Rotor,
    Vehicle,
    find_vehicle,
    load_vehicle,
)


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


def test_allocation_is_equation_2():
    x, y, c = 0.80 / 2, 0.70 / 2, 0.01
    expected = [
        [1, 1, 1, 1, 1, 1, 1, 1],
        [-y, -y, y, y, -y, -y, y, y],
        [-x, x, x, -x, -x, x, x, -x],
        [c, -c, c, -c, -c, c, -c, c],
    ]
    vehicle, _ = load_vehicle("StarOne")
    np.testing.assert_allclose(vehicle.allocation, expected, atol=1e-12)
    assert vehicle.mass == 3.0 and vehicle.inertia == [0.055, 0.060, 0.100]
    for upper, lower in zip(vehicle.rotors[:4], vehicle.rotors[4:]):
        assert upper.position[:2] == lower.position[:2]
        assert upper.position[2] > lower.position[2]
        assert {upper.direction, lower.direction} == {"cw", "ccw"}


numbers = st.floats(-2.0, 2.0)
rotors = st.builds(
    Rotor,
    position=st.lists(numbers, min_size=3, max_size=3),
    direction=st.sampled_from(["ccw", "cw"]),
    thrust_coefficient=st.floats(1e-6, 1e-2),
    torque_ratio=st.floats(1e-3, 0.1),
    max_thrust=st.floats(0.1, 100.0),
    radius=st.floats(0.01, 0.5),
)


@given(st.lists(rotors, min_size=1, max_size=12))
def test_allocation_is_force_moment_and_reaction(table):
    """Of any rotors: r x f, and the torque that the air exerts on the propeller."""
    vehicle = Vehicle(rotors=table)
    for rotor, column in zip(table, vehicle.allocation.T):
        moment = np.cross(rotor.position, [0.0, 0.0, 1.0])
        spin = 1.0 if rotor.direction == "ccw" else -1.0  # about z
        moment[2] -= spin * rotor.torque_ratio
        np.testing.assert_allclose(column, [1.0, *moment], atol=1e-12)
        reach = np.linalg.norm(rotor.position[:2]) + rotor.radius
        assert reach <= vehicle.radius + 1e-12
    assert vehicle.allocation.shape == (4, len(table))


@pytest.mark.parametrize("drone", RACERS)
def test_shipped_racers_have_the_reference_limits(drone):
    vehicle, sdf = load_vehicle(drone)
    assert vehicle.name == drone and sdf.is_file()
    np.testing.assert_allclose(vehicle.max_thrusts, 8.5)
    np.testing.assert_allclose(vehicle.thrust_coefficients * vehicle.max_speeds**2, 8.5)
    np.testing.assert_allclose(vehicle.thrust_coefficients, 1e-3)


def test_vadr_is_as_the_qualifier_says():
    """51.7 m/s^2 at full thrust, 280 mm wide, the camera in the middle and 20 deg up."""
    vehicle, _ = load_vehicle("vadr")
    assert vehicle.max_thrusts.sum() / vehicle.mass == pytest.approx(51.7, abs=0.02)
    # In hover, where two of its rotors stop and two give twice as much.
    most = np.abs(vehicle.allocation[1:]) @ np.full(4, vehicle.mass * GRAVITY / 4)
    np.testing.assert_allclose(most / vehicle.inertia, [260.0, 260.0, 80.0], rtol=0.01)
    half = max(np.abs(r.position[:2]).max() + r.radius for r in vehicle.rotors)
    assert 2 * half == pytest.approx(0.28)
    X_BC = vehicle.camera.X_BC
    np.testing.assert_array_equal(X_BC.translation(), 0.0)
    up = np.deg2rad(20.0)
    np.testing.assert_allclose(X_BC.rotation().col(2), [np.cos(up), 0, np.sin(up)], atol=1e-12)


def test_racers_are_some_of_the_shipped_drones():
    assert set(RACERS) < set(DRONES)


def test_radius():
    assert load_vehicle("Default")[0].radius == pytest.approx(np.hypot(0.15, 0.15) + 0.1)
    assert load_vehicle("StarOne")[0].radius == pytest.approx(np.hypot(0.40, 0.35) + 0.19)


def test_the_camera_looks_along_x_and_turns():
    p = [0.1, 0.0, -0.05]
    X_BC = CameraMount(position=p).X_BC
    np.testing.assert_allclose(X_BC.rotation().col(2), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(X_BC.rotation().col(1), [0, 0, -1], atol=1e-12)
    np.testing.assert_array_equal(X_BC.translation(), p)
    down = CameraMount(rpy_deg=[0.0, 90.0, 0.0]).X_BC.rotation()
    np.testing.assert_allclose(down.col(2), [0, 0, -1], atol=1e-12)
    left = CameraMount(rpy_deg=[0.0, 0.0, 90.0]).X_BC.rotation()
    np.testing.assert_allclose(left.col(2), [0, 1, 0], atol=1e-12)


def test_unknown_drone():
    with pytest.raises(UserError, match="choose from Default, StarOne, or name the folder"):
        load_vehicle("Fokker")


@pytest.mark.parametrize("relative", [False, True])
def test_a_folder_of_ones_own(tmp_path, monkeypatch, relative):
    shutil.copytree(find_vehicle("StarOne").parent, tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    vehicle, sdf = load_vehicle("mine" if relative else str(tmp_path / "mine"))
    assert vehicle == load_vehicle("StarOne")[0]
    assert sdf.samefile(tmp_path / "mine" / "star_one.sdf")
    # A shipped name means the shipped drone, whatever lies in the working directory.
    (tmp_path / "mine").rename(tmp_path / "Default")
    assert load_vehicle("Default")[0].name == "Default"
    assert load_vehicle("./Default")[0].name == "StarOne"


@pytest.mark.parametrize(
    "change, words",
    [
        (dict(name=""), "no name"),
        (dict(mass=-1.0), "mass"),
        (dict(mass=math.nan), "mass"),
        (dict(mass=10.0), "cannot lift"),
        (dict(inertia=[0.01, math.nan, 0.01]), "inertia"),
        (dict(inertia=[0.01, 0.01, 0.03]), "triangle"),
        (dict(inertia=[0.01]), "inertia"),
        (dict(rotor_lag=0.0), "rotor_lag"),
        (dict(rotors=[]), "rotors"),
        (dict(camera=CameraMount(position=[0.0])), "camera.position"),
        (dict(imu=ImuMount(position=[0.0, 0.0, math.nan])), "imu.position needs three finite"),
        (dict(drag=Drag(linear=[-0.1, 0.0, 0.0])), "drag.linear"),
        (
            dict(original_gains=OriginalGains(1.0, 1.0, 1.0)),
            "all four original_gains must be positive",
        ),
        (dict(betaflight_share=1.1), "betaflight_share must be from 0.1 to 1"),
    ],
)
def test_impossible_vehicles(change, words):
    vehicle, _ = load_vehicle("Default")
    with pytest.raises(ValueError, match=words):
        dc.replace(vehicle, **change).check()


def test_rotors_that_cannot_do_it():
    vehicle, _ = load_vehicle("Default")
    in_line = [dc.replace(r, position=[0.1 * i, 0.0, 0.0]) for i, r in enumerate(vehicle.rotors)]
    with pytest.raises(ValueError, match="moments"):
        dc.replace(vehicle, rotors=in_line).check()
    ahead = [dc.replace(r, position=[r.position[0] + 0.2, *r.position[1:]]) for r in vehicle.rotors]
    with pytest.raises(ValueError, match="cannot hold it level"):
        dc.replace(vehicle, rotors=ahead).check()
    with pytest.raises(ValueError, match="ccw or cw"):
        dc.replace(vehicle, rotors=[dc.replace(vehicle.rotors[0], direction="left")]).check()
