"""How well Betaflight flies: steps of its rates, and laps, for five sets of its settings.

    python -m benchmarks.betaflight [--quick] [--only steps laps] [--json FILE]

A step is of 3 rad/s, or 1 rad/s of yaw, of a free body with the drone's inertia and rotors, at the
thrust of a hover. Laps are flown on the known map of student-airrace, with the IMU's noise, within
the limits of the rotors. It takes what `airrace betaflight build` builds.
"""

import contextlib
import sys
import tempfile
from pathlib import Path

import numpy as np

import airrace
from airrace.betaflight.firmware import find_firmware
from airrace.betaflight.firmware_process import NO_RADIO, PERIOD, FirmwareProcess
from airrace.betaflight.settings import configure
from airrace.betaflight.sticks import Sticks
from airrace.betaflight.transport import find_settings, join_betaflight
from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.rotors import make_rotor_dynamics, next_speed
from benchmarks import harness
from benchmarks.harness import make_table

# What each set changes in the shipped settings.
SETS = {
    "shipped": "",
    "P halved": "set p_roll = 22\nset p_pitch = 22\n",
    "P doubled": "set p_roll = 90\nset p_pitch = 90\n",
    "no D": "set d_roll = 0\nset d_pitch = 0\n",
    "hardly filtered": (
        "set gyro_lpf1_static_hz = 0\n"
        "set dterm_lpf1_static_hz = 150\n"
        "set dterm_lpf2_static_hz = 0\n"
    ),
}
_STEPS = {"roll": 3.0, "yaw": 1.0}  # rad/s: about z, rotors have little moment
_DURATION = 0.6  # s, of a step
_BOOT = 500, 5500, 500  # steps without a radio, with it, and armed
_SHARES = 0.63, 0.9
_LAPS = (
    "{flight_controller: betaflight, map: track, camera: {renderer: none},"
    " planner: {limits: rotor}, recording: {content: light}, "
)


def main(argv=None) -> int:
    """Flies everything and prints the tables."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="the shipped settings only, one lap")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=["steps", "laps"],
        default=["steps", "laps"],
        help="these sections (default: all)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns the rows of every section."""
    names = list(SETS)[:1] if args.quick else list(SETS)
    figures = {}
    with tempfile.TemporaryDirectory() as scratch:
        sources = {name: _source(Path(scratch), name) for name in names}
        if "steps" in args.only:
            figures["steps"] = [
                {"set": name, "axis": axis} | step_response(sources[name], axis)
                for name in names
                for axis in _STEPS
            ]
        if "laps" in args.only:
            figures["laps"] = [
                {"set": name} | lap(sources[name], 1 if args.quick else 3) for name in names
            ]
    return figures


def _source(folder: Path, name: str) -> Path:
    shipped = find_settings(load_scenario()).read_text(encoding="utf-8")
    path = folder / f"{name.replace(' ', '_')}.txt"
    path.write_text(shipped + SETS[name], encoding="utf-8")
    return path


def step_response(source: Path, axis: str) -> dict:
    """Returns the times to 63 % and 90 % of a step (s), and its overshoot, as a share."""
    firmware, (vehicle, _) = find_firmware(), load_vehicle("Default")
    with tempfile.TemporaryDirectory() as folder:
        dump, _ = configure(firmware, source, Path(folder))
        sticks = Sticks(dump, vehicle)
        with contextlib.closing(FirmwareProcess(firmware, Path(folder))) as process:
            boot = NO_RADIO, sticks.at_rest(armed=False), sticks.at_rest(armed=True)
            for number, channels in zip(_BOOT, boot):
                for _ in range(number):
                    process.step(channels)
            wanted = np.zeros(3)
            wanted[("roll", "pitch", "yaw").index(axis)] = _STEPS[axis]
            rates = fly_step(process, sticks, vehicle, wanted)
    shares = rates @ wanted / (wanted @ wanted)
    reached = [float(np.argmax(shares >= share)) * PERIOD for share in _SHARES]
    t63, t90 = (t if t > 0.0 else np.inf for t in reached)
    return {"t63": t63, "t90": t90, "overshoot": max(0.0, float(shares.max()) - 1.0)}


def fly_step(process: FirmwareProcess, sticks: Sticks, vehicle, wanted) -> np.ndarray:
    """Returns the rates (rad/s) of a free body in each millisecond of a step, (n, 3).

    Args: process: armed. sticks: of its settings. vehicle: its body. wanted: rates, (3,).
    """
    rotors, inertia = make_rotor_dynamics(vehicle, PERIOD), np.array(vehicle.inertia)
    hover = vehicle.mass * GRAVITY
    speeds = np.sqrt(hover / len(vehicle.rotors) / vehicle.thrust_coefficients)
    w, rates = np.zeros(3), []
    command = np.array((hover, 0.0, 0.0, 0.0))
    settle = round(0.2 / PERIOD)  # the motors start
    for i in range(settle + round(_DURATION / PERIOD)):
        command[1:] = wanted * (i >= settle)
        thrusts = vehicle.thrust_coefficients * np.square(speeds)
        f, *moment = vehicle.allocation @ thrusts
        imu = np.array((*w, 0.0, 0.0, f / vehicle.mass))
        targets = sticks.rotor_speeds(process.step(sticks.channels(command), imu))
        w = w + PERIOD * (np.array(moment) - np.cross(w, inertia * w)) / inertia
        speeds = np.array(
            [
                next_speed(speed, each, most, rotors.step_share)
                for speed, each, most in zip(speeds, targets, rotors.max_speeds)
            ]
        )
        rates.append(w)
    return np.array(rates[settle:])


def lap(source: Path, laps: int) -> dict:
    """Returns how laps went, how well they were tracked (m), and how fast the race was."""
    scenario = load_scenario(scenario_text=f"{_LAPS} laps: {laps}, betaflight_config: {source}}}")
    scenario.check()
    with tempfile.TemporaryDirectory() as folder:
        with join_betaflight(scenario, Path(folder), lambda line: None) as transport:
            result = run_race(scenario, Path(folder), transport=transport)
        errors = tracking_errors(airrace.load_run(folder), result["laps"])
    times = [each["time_s"] for each in result["laps"]]
    return {
        "finished": result["finished"],
        "flown": len(times),
        "mean_lap": float(np.mean(times)) if times else np.nan,
        "rms": float(np.sqrt(np.mean(np.square(errors)))) if times else np.nan,
        "worst": float(errors.max()) if times else np.nan,
        "real_time": result["wall"]["real_time_factor"],
    }


def tracking_errors(run, laps: list) -> np.ndarray:
    """Returns the distances from the reference (m) in laps that were flown, as race.json has them.

    Args: run: that was recorded.
    """
    if not laps:
        return np.zeros(0)
    reference, state = run.reference, run.state
    begin, end = laps[0]["start_s"], laps[-1]["start_s"] + laps[-1]["time_s"]
    reference = reference[(reference.time >= begin) & (reference.time <= end)]
    apart = [np.interp(reference.time, state.time, state[x]) - reference[x] for x in "xyz"]
    return np.linalg.norm(apart, axis=0)


def show(figures: dict) -> tuple[list, bool]:
    """Returns the tables, and whether the shipped settings finished."""
    tables = []
    if "steps" in figures:
        columns = {
            "settings": "{set}",
            "axis": "{axis}",
            "63 % after (ms)": "{t63:.0f}",
            "90 % after (ms)": "{t90:.0f}",
            "overshoot": "{overshoot:.0%}",
        }
        rows = [row | {t: 1e3 * row[t] for t in ("t63", "t90")} for row in figures["steps"]]
        tables.append(make_table("Steps of the rates", rows, columns))
    if "laps" in figures:
        columns = {
            "settings": "{set}",
            "laps": "{flown}",
            "mean lap (s)": "{mean_lap:.2f}",
            "RMS (cm)": "{rms:.1f}",
            "worst (cm)": "{worst:.1f}",
            "x real time": "{real_time:.1f}",
        }
        rows = [row | {x: 1e2 * row[x] for x in ("rms", "worst")} for row in figures["laps"]]
        tables.append(make_table("Laps within the limits of the rotors", rows, columns))
    return tables, all(row["finished"] for row in figures.get("laps", ())[:1])


if __name__ == "__main__":
    sys.exit(main())
