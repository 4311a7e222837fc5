"""How well Betaflight flies, and how fast: rates, laps, throttles and pixels.

    python -m benchmarks.betaflight [--quick] [--only steps laps throttle races pixels]
                                    [--json FILE]

A step is of 3 rad/s, or 1 rad/s of yaw, of a free body with the drone's inertia and rotors, at the
thrust of a hover. Laps are flown on the known map of student-airrace, with the IMU's noise, within
the limits of the rotors, by five sets of settings. Held on a table, how much of a thrust there is
with what bends the way to it: thrust_linear, and a battery. Races are flown with the controller
that drives the motors itself, and with Betaflight, to compare their laps; and short ones from
pixels by turns: the ratio of their times is of one computer, at one time. It takes what `airrace
betaflight build` builds.
"""

import contextlib
import dataclasses as dc
import functools
import itertools
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import airrace
from airrace.betaflight.firmware import find_firmware
from airrace.betaflight.firmware_process import PERIOD
from airrace.betaflight.settings import configure
from airrace.betaflight.step_response import fly_step, start_armed
from airrace.betaflight.sticks import Sticks
from airrace.betaflight.transport import find_settings, join_betaflight
from airrace.diagrams.in_process import InProcess
from airrace.diagrams.race import run_race
from airrace.scenario import load_scenario
from airrace.vehicle import GRAVITY, load_vehicle
from airrace.vehicle.battery import Battery, Pack
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
_LAPS = "{map: track, camera: {renderer: none}, recording: {content: light}, "
_ROTOR = "planner: {limits: rotor}, "
# Of a drone whose rotors take 14 W in a hover, and 89 W at most: a tenth of the voltage is lost.
_BATTERY = Battery(full=12.6, empty=10.5, capacity=0.35, resistance=0.18, efficiency=0.35)
_LINEAR = "set thrust_linear = 40\n"


class Throttle(NamedTuple):
    """A way from a throttle to thrust."""

    name: str
    changes: str = ""  # lines of the settings
    known: tuple[str, str] | None = None  # what the sticks take for what, in the settings
    battery: Battery | None = None


_THROTTLES = (
    Throttle("shipped"),
    Throttle("a battery that sags", battery=_BATTERY),
    Throttle("and nobody hears of it", battery=dc.replace(_BATTERY, heard=False)),
    Throttle("thrust_linear = 40", _LINEAR),
    Throttle("and the sticks do not know", _LINEAR, ("linear = 40", "linear = 0")),
    Throttle("vbat_sag_compensation = 100", "set vbat_sag_compensation = 100\n"),
)
_LOADS = 0.5, 1.0, 2.0, 3.0  # weights of the drone
_HELD = 300  # steps, of each load
# Fields of races that are to go as without Betaflight.
_RACES = {
    "from pixels": "laps: 10",
    "from pixels, vio": "laps: 3, estimator: vio",
    "rotor limits, from pixels": f"{_ROTOR}laps: 6",
}
_BOTH = "internal", "betaflight"
SECTIONS = "steps", "laps", "throttle", "races", "pixels"


def main(argv=None) -> int:
    """Flies everything and prints the tables."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="the shipped settings only, one lap")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SECTIONS,
        default=SECTIONS,
        help="these sections (default: all)",
    )
    return harness.run(parser, argv, measure, show)


def measure(args) -> dict:
    """Returns the rows of every section."""
    names = list(SETS)[:1] if args.quick else list(SETS)
    figures, laps = {}, 1 if args.quick else 3
    with tempfile.TemporaryDirectory() as scratch:
        sources = {name: _source(Path(scratch), name) for name in names}
        if "steps" in args.only:
            figures["steps"] = [
                {"set": name, "axis": axis} | step(name, axis)
                for name in harness.progress(names, "steps")
                for axis in _STEPS
            ]
        if "laps" in args.only:
            figures["laps"] = [
                {"set": name} | lap(sources[name], _LAPS + _ROTOR, laps)
                for name in harness.progress(names, "laps")
            ]
        if "throttle" in args.only:
            figures["throttle"] = throttles()
    if "races" in args.only:
        figures["races"] = [
            {"race": name, "flight controller": both} | _fly_with(both, fields)
            for name, fields in harness.progress(_RACES.items(), "races", len(_RACES))
            for both in _BOTH
        ]
    if "pixels" in args.only:
        figures["pixels"] = [
            {"flight controller": both} | _fly_with(both, "laps: 1")
            for _ in harness.progress(range(laps), "pixels")
            for both in _BOTH
        ]
    return figures


def _fly_with(flight_controller: str, fields: str) -> dict:
    light = "recording: {content: light}"
    return race(f"{{{fields}, {light}, flight_controller: {flight_controller}}}")


def throttles() -> list[dict]:
    """Returns what share of some commanded thrusts rotors give, of a drone that is held."""
    firmware, (vehicle, _) = find_firmware(), load_vehicle("Default")
    rows = []
    for changes, cases in itertools.groupby(_THROTTLES, lambda case: case.changes):
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "team.txt"
            source.write_text(_shipped() + changes, encoding="utf-8")
            dump, _ = configure(firmware, source, Path(folder))
            true = Sticks(dump, vehicle)
            with contextlib.closing(start_armed(firmware, Path(folder), true)) as process:
                for case in cases:
                    known = dump.replace(*case.known) if case.known else dump
                    held = functools.partial(
                        _given, process, Sticks(known, vehicle), vehicle, case.battery
                    )
                    rows.append({"set": case.name} | {_key(load): held(load) for load in _LOADS})
    return rows


def _key(load: float) -> str:
    return f"w{100 * load:.0f}"


def _given(process, sticks, vehicle, battery, load) -> float:
    """Returns the given share of a thrust. Args: load: the thrust, in weights of the drone."""
    wanted = load * vehicle.mass * GRAVITY
    pack = Pack(battery, vehicle) if battery else None
    speeds, thrusts = np.zeros(sticks.rotors), []
    for _ in range(_HELD):
        supply = pack.supply if pack else 1.0
        heard = supply if battery and battery.heard else 1.0
        outputs = process.step(sticks.channels(np.array((wanted, 0.0, 0.0, 0.0)), heard))
        speeds = sticks.rotor_speeds(outputs, supply)
        if pack:
            pack.step(speeds, PERIOD)
        thrusts.append(vehicle.thrust_coefficients @ speeds**2)
    return float(np.mean(thrusts[_HELD // 2 :])) / wanted


def _source(folder: Path, name: str) -> Path:
    path = folder / f"{name.replace(' ', '_')}.txt"
    path.write_text(_shipped() + SETS[name], encoding="utf-8")
    return path


def _shipped() -> str:
    return find_settings(load_scenario()).read_text(encoding="utf-8")


def step(name: str, axis: str) -> dict:
    """Returns the times to 63 % and 90 % of a step (s), and its overshoot, as a share."""
    flown = fly_step(SETS[name], axis=axis, size=_STEPS[axis])
    t63, t90 = flown.rise_times
    return {"t63": t63, "t90": t90, "overshoot": flown.overshoot}


def lap(source: Path, fields: str, laps: int) -> dict:
    """Returns how laps went with some settings; see race(). Args: fields: of the scenario."""
    return race(
        f"{fields} laps: {laps}, flight_controller: betaflight, betaflight_config: {source}}}"
    )


def race(text: str) -> dict:
    """Returns how the laps of a scenario's race were tracked (m), and how fast that was."""
    scenario = load_scenario(scenario_text=text)
    scenario.check()
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        transport = InProcess()
        if scenario.flight_controller != "internal":
            join = join_betaflight(scenario, Path(folder), lambda line: None)
            transport = stack.enter_context(join)
        result = run_race(scenario, Path(folder), transport=transport)
        errors = tracking_errors(airrace.load_run(folder), result["laps"])
    times = [each["time_s"] for each in result["laps"]]
    return {
        "finished": result["finished"],
        "flown": len(times),
        "mean_lap": float(np.mean(times)) if times else np.nan,
        "settled": float(np.mean(times[2:])) if times[2:] else np.nan,
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
    titles = {
        "laps": "Laps within the limits of the rotors",
        "races": "Races with either",
        "pixels": "Races from pixels by turns",
    }
    for section in (each for each in titles if each in figures):
        firsts = [x for x in ("set", "race", "flight controller") if x in figures[section][0]]
        columns = {x: f"{{{x}}}" for x in firsts} | {
            "laps": "{flown}",
            "mean lap (s)": "{mean_lap:.2f}",
            "from the third on (s)": "{settled:.2f}",
            "RMS (cm)": "{rms:.1f}",
            "worst (cm)": "{worst:.1f}",
            "x real time": "{real_time:.1f}",
        }
        rows = [row | {x: 1e2 * row[x] for x in ("rms", "worst")} for row in figures[section]]
        tables.append(make_table(titles[section], rows, columns))
    if "throttle" in figures:
        columns = {"settings": "{set}"}
        columns |= {f"at {load:g} x weight": f"{{{_key(load)}:.1%}}" for load in _LOADS}
        tables.append(make_table("Thrust, of what is commanded", figures["throttle"], columns))
    if "pixels" in figures:
        times = [row["real_time"] for row in figures["pixels"]]
        ratio = np.mean(times[1::2]) / np.mean(times[::2])
        tables.append(f"With Betaflight it is {ratio:.2f} times as fast as without.")
    return tables, all(row["finished"] for row in figures.get("laps", ())[:1])


if __name__ == "__main__":
    sys.exit(main())
