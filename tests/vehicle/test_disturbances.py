import dataclasses as dc

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.vehicle import DRONES, load_vehicle
from airrace.vehicle.disturbances import (
    DisturbancesConfig,
    RotorFailure,
    check_rotors_exist,
    failures_clause,
    true_vehicle,
)

ERRORS = {"mass_error": 0.1, "inertia_error": 0.2, "thrust_coefficient_error": 0.3}


@pytest.mark.parametrize("drone", DRONES)
def test_without_errors_it_is_the_vehicle(drone):
    vehicle, _ = load_vehicle(drone)
    assert true_vehicle(vehicle, DisturbancesConfig(), seed=3) == vehicle


def draws(vehicle, **errors):
    """The factors on mass, inertia and thrust coefficients of many seeds, one a row."""
    config = DisturbancesConfig(**errors)
    rows = []
    for seed in range(500):
        truth = true_vehicle(vehicle, config, seed)
        rows.append(
            [
                truth.mass / vehicle.mass,
                *np.divide(truth.inertia, vehicle.inertia),
                *(truth.thrust_coefficients / vehicle.thrust_coefficients),
            ]
        )
    return np.array(rows)


@pytest.mark.parametrize("drone", DRONES)
def test_errors_are_uniform_and_independent(drone):
    vehicle, _ = load_vehicle(drone)
    rows = draws(vehicle, **ERRORS)
    np.testing.assert_allclose(rows[:, 1:3], rows[:, 2:4], rtol=1e-12)  # one for all moments
    rows = np.delete(rows, [2, 3], axis=1)
    size = np.array([0.1, 0.2, *[0.3] * len(vehicle.rotors)])
    shares = (rows - 1.0) / size
    assert np.all(np.abs(shares) <= 1.0)
    assert np.abs(shares).max(axis=0) == pytest.approx(1.0, abs=0.02)
    # A uniform distribution's mean and variance.
    assert shares.mean(axis=0) == pytest.approx(0.0, abs=0.1)
    assert shares.var(axis=0) == pytest.approx(1 / 3, rel=0.15)
    correlation = np.corrcoef(shares.T) - np.eye(len(size))
    assert np.abs(correlation).max() < 0.2


def test_an_error_does_not_change_the_others():
    vehicle, _ = load_vehicle("Default")
    both, one = draws(vehicle, **ERRORS), draws(vehicle, **(ERRORS | {"mass_error": 0.0}))
    np.testing.assert_array_equal(both[:, 1:], one[:, 1:])
    np.testing.assert_array_equal(one[:, 0], 1.0)


def test_what_has_no_error_stays():
    """Above all the speed limits: a motor does not turn faster for its propeller's thrust."""
    vehicle, _ = load_vehicle("Default")
    truth = true_vehicle(vehicle, DisturbancesConfig(**ERRORS), seed=1)
    assert truth.mass != vehicle.mass
    np.testing.assert_allclose(truth.max_speeds, vehicle.max_speeds, rtol=1e-12)
    np.testing.assert_array_equal(truth.allocation, vehicle.allocation)
    for rotor, nominal in zip(truth.rotors, vehicle.rotors):
        assert rotor.thrust_coefficient != nominal.thrust_coefficient
        assert (
            dc.replace(
                rotor, thrust_coefficient=nominal.thrust_coefficient, max_thrust=nominal.max_thrust
            )
            == nominal
        )
    assert vehicle == load_vehicle("Default")[0]  # untouched
    assert (
        dc.replace(truth, mass=vehicle.mass, inertia=vehicle.inertia, rotors=vehicle.rotors)
        == vehicle
    )


def test_the_seed_decides():
    vehicle, _ = load_vehicle("Default")
    config = DisturbancesConfig(**ERRORS)
    assert true_vehicle(vehicle, config, 1) == true_vehicle(vehicle, config, 1)
    assert true_vehicle(vehicle, config, 1) != true_vehicle(vehicle, config, 2)


def test_rotors_that_are_not_there_cannot_fail():
    vehicle, _ = load_vehicle("Default")
    check_rotors_exist([], vehicle)
    check_rotors_exist([RotorFailure(rotor, 1.0) for rotor in (1, 2, 3, 4)], vehicle)
    with pytest.raises(UserError) as e:
        check_rotors_exist([RotorFailure(4, 1.0), RotorFailure(9, 1.0)], vehicle)
    assert str(e.value) == ("rotor_failures: there is no rotor 9; the Default has rotors 1 to 4.")


@pytest.mark.parametrize(
    "time, clause",
    [
        (9.9, ""),
        (10.0, " after rotor 3 had failed"),
        (20.0, " after rotors 1 and 3 had failed"),
        (99.0, " after rotors 1, 2 and 3 had failed"),
    ],
)
def test_failures_in_words(time, clause):
    failures = [RotorFailure(3, 10.0), RotorFailure(1, 20.0), RotorFailure(2, 30.0)]
    assert failures_clause(failures, time) == clause
