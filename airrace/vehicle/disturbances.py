"""What the world does that the autonomy is not told."""

import dataclasses as dc

from airrace.common.errors import UserError
from airrace.math.random import make_generator
from airrace.vehicle.vehicle import Vehicle


@dc.dataclass
class WindConfig:
    """A steady wind with gusts, an Ornstein-Uhlenbeck process on each axis."""

    mean: list[float] = dc.field(default_factory=lambda: [0.0] * 3)  # m/s, in the world
    gust_rms: float = 0.0  # m/s, of each component
    gust_time: float = 2.0  # s, over which a gust fades to 1 / e
    mean_speed: float = 0.0  # m/s, on top of mean: level, in a direction that the seed draws


@dc.dataclass
class DisturbancesConfig:
    """How the simulated drone and its world differ from the vehicle's file.

    An error e is drawn once a race, uniformly from [-e, e], as a share of
    what it falsifies.
    """

    wind: WindConfig = dc.field(default_factory=WindConfig)
    drag: float = 0.0  # share of the vehicle's drag: 0 as in the original system, 1 all
    mass_error: float = 0.0  # of the mass
    inertia_error: float = 0.0  # of all moments of inertia alike
    thrust_coefficient_error: float = 0.0  # of each rotor, drawn on its own
    actuator_delay: float = 0.0  # s, of rotor speed commands: whole periods of scenario.rotors
    gate_shift: float = 0.0  # m, how far a gate may move between laps; see GateMover

    def periods_of_delay(self, period: float) -> int:
        """Returns for how many of the rotors' periods (s) commands are on their way."""
        delay = self.actuator_delay
        return max(1, round(delay / period)) if delay > 0.0 else 0


@dc.dataclass
class RotorFailure:
    """A rotor that stops in flight."""

    rotor: int = 0  # number in the vehicle's table, from 1
    time: float = 0.0  # s


def true_vehicle(vehicle: Vehicle, config: DisturbancesConfig, seed: int) -> Vehicle:
    """Returns the drone that is simulated, where the autonomy knows ``vehicle``.

    The moments of inertia share one factor, so that no error breaks their
    triangle inequality.
    """
    errors = make_generator(seed, "vehicle").uniform(-1.0, 1.0, 2 + len(vehicle.rotors)).tolist()
    inertia = 1.0 + config.inertia_error * errors[1]
    thrusts = [1.0 + config.thrust_coefficient_error * error for error in errors[2:]]
    return dc.replace(
        vehicle.with_thrusts(thrusts),
        mass=vehicle.mass * (1.0 + config.mass_error * errors[0]),
        inertia=[J * inertia for J in vehicle.inertia],
    )


def check_rotors_exist(failures: list[RotorFailure], vehicle: Vehicle) -> None:
    """Raises UserError if a rotor fails that the vehicle does not have."""
    n = len(vehicle.rotors)
    for failure in failures:
        if failure.rotor > n:
            raise UserError(
                f"rotor_failures: there is no rotor {failure.rotor}; "
                f"the {vehicle.name} has rotors 1 to {n}."
            )


def failures_clause(failures: list[RotorFailure], time: float) -> str:
    """Returns `` after rotor 3 had failed``, or an empty string if none had at a time (s)."""
    rotors = [str(rotor) for rotor in sorted(f.rotor for f in failures if f.time <= time)]
    if not rotors:
        return ""
    if len(rotors) == 1:
        return f" after rotor {rotors[0]} had failed"
    return f" after rotors {', '.join(rotors[:-1])} and {rotors[-1]} had failed"
