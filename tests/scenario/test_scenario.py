import copy
import dataclasses as dc
import functools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_dump_typed
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import SimulatorConfig

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml, models_path
from airrace.diagrams.race import run_race
from airrace.diagrams.race_command import RaceOptions, race_scenario
from airrace.rendering.vtk.vtk_renderer import check_vtk_available
from airrace.scenario import CONTENTS, RecordingConfig, Scenario, load_scenario, scenario_yaml
from airrace.scenario.camera_config import PRESETS
from airrace.scenario.checks import UNLIMITED
from airrace.scenario.mavlink_config import MavlinkConfig, QuirksConfig
from airrace.vehicle.disturbances import DisturbancesConfig, RotorFailure, WindConfig
from airrace.vehicle.sensor_failures import IMU_FAILURES, CameraFailure, ImuFailure
from tests.worlds.cases import guarded
from tests.worlds.looks import Looks

SHIPPED = [
    (path.stem, name)
    for path in sorted((models_path() / "scenarios").glob("*.yaml"))
    if path.stem != "grand_prix"  # is flown by clients
    for name in yaml.safe_load(path.read_text())
]
SECTIONS = [f.name for f in dc.fields(Scenario) if dc.is_dataclass(getattr(Scenario(), f.name))]


def as_yaml(scenario):
    """All that a scenario says: Drake's structs do not compare."""
    return yaml_dump_typed(scenario, schema=Scenario)


def refusal(**kwargs):
    """Returns what load_scenario() or check() say to a bad scenario."""
    with pytest.raises(UserError) as e:
        load_scenario(**kwargs).check()
    message = str(e.value)
    assert "\n" not in message
    return message


def leaves(value, path=()):
    """Yields the paths to all plain values of a document, and the values."""
    if isinstance(value, (dict, list)):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, (*path, key))
    else:
        yield path, value


def dotted(path):
    """As messages write it: rotor_failures[0].time."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in path).lstrip(".")


@functools.cache
def document():
    """All fields of a good scenario: every list has an element, every number is there."""
    scenario = Scenario(
        disturbances=DisturbancesConfig(drag=1.0),
        rotor_failures=[RotorFailure(3, 60.0)],
        imu_failures=[ImuFailure("nan", 60.0, 1.0)],
        camera_failures=[CameraFailure("dark", 60.0, 1.0)],
    )
    scenario.referee.time_limit = 100.0
    return yaml.safe_load(as_yaml(scenario))


def changed(path, value):
    """The text of that scenario with another value at a path."""
    result = copy.deepcopy(document())
    *parents, key = path
    place = result
    for parent in parents:
        place = place[parent]
    place[key] = value
    return yaml.dump(result, Dumper=yaml.CSafeDumper)


def test_the_defaults_are_good():
    scenario = load_scenario()
    scenario.check()
    assert as_yaml(scenario) == as_yaml(Scenario())
    assert as_yaml(load_scenario(filename="races")) == as_yaml(Scenario())


@pytest.mark.slow
@pytest.mark.parametrize("filename, name", SHIPPED)
def test_shipped_scenarios_fly(tmp_path, filename, name):
    scenario = load_scenario(filename=filename, scenario_name=name)
    scenario.check()
    # Level 1 is what the original system flew, and so the default.
    same = as_yaml(scenario) == as_yaml(Scenario())
    assert same == (name == "Level1" or (filename, name) == ("races", "Defaults"))
    scenario.referee.time_limit = 2.0
    if scenario.camera.renderer == "vtk":
        scenario.camera.width, scenario.camera.height = 640, 360
        try:
            check_vtk_available()
        except UserError as e:
            pytest.skip(str(e))
    looks = Looks()

    def end_in_the_air(event):
        looks.take(event)
        if looks and looks[-1].state[6] > 0.3:  # it stands at 0.1
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_race(scenario, tmp_path, sinks=[end_in_the_air])
    assert json.loads((tmp_path / "race.json").read_text())["track"] == "student-airrace"


def disturbances(scenario):
    """Paths and values of all the trouble of a scenario."""
    return dict(leaves(yaml.safe_load(as_yaml(scenario))["disturbances"]))


def test_a_level_is_the_one_before_and_a_little_more():
    """Each makes what the one before left out worse, and nothing better."""
    levels = [load_scenario(filename="levels", scenario_name=f"Level{n}") for n in range(5)]
    noises = [(s.state_noise, list(PRESETS).index(s.camera.preset)) for s in levels]
    assert noises == [("none", 0), ("nominal", 1), ("nominal", 1), ("nominal", 2), ("nominal", 2)]
    numbers = [disturbances(scenario) for scenario in levels]
    assert numbers[0] == numbers[1] == disturbances(Scenario())
    for easier, harder in zip(numbers[1:], numbers[2:]):
        assert all(harder[path] >= easier[path] for path in easier)
    new = [
        {dotted(path) for path in easier if harder[path] > easier[path]}
        for easier, harder in zip(numbers[1:], numbers[2:])
    ]
    assert new == [
        {"mass_error", "inertia_error", "thrust_coefficient_error", "actuator_delay"},
        {"drag", "wind.mean_speed", "wind.gust_rms"},
        {"gate_shift"},
    ]


def test_a_levels_table_tells_its_values():
    """What the comments say varies is in the scenario, and the other way round."""
    text = (models_path() / "scenarios" / "levels.yaml").read_text()
    parts = re.split(r"^# Level (\d): ", text, flags=re.M)[1:]
    tables = dict(zip(map(int, parts[::2]), parts[1::2]))
    assert sorted(tables) == list(range(5))
    told = set()
    for level, part in tables.items():
        table, _, body = part.partition(f"Level{level}:")
        rows = re.findall(r"^#   \(?((?:state_noise|camera|disturbances)\S*) +(.*)$", table, re.M)
        told |= {name.removeprefix("disturbances.") for name, _ in rows}
        scenario = yaml.safe_load(
            as_yaml(load_scenario(filename="levels", scenario_name=f"Level{level}"))
        )
        for name, words in rows:
            value = scenario
            for key in name.split("."):
                value = value[key]
            if isinstance(value, str):
                assert words.startswith(value)
            else:
                found = [float(x) for x in re.findall(r"\d+(?:\.\d+)?", words)]
                assert value in found or 100 * value in found, (level, name, words)
    plain = disturbances(Scenario())
    hardest = disturbances(load_scenario(filename="levels", scenario_name="Level4"))
    for path, value in hardest.items():
        assert (value != plain[path]) == (dotted(path) in told), path


def test_defaults_then_file_then_text(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "Defaults: {laps: 2, seed: 3, explorer: {max_speed: 4.0, rate: 10.0}}\n"
        "Other: {laps: 5, systems: {explorer: a:b}}\n"
    )
    scenario = load_scenario(filename=str(path))
    assert (scenario.laps, scenario.seed, scenario.trajectory) == (2, 3, "optimal")
    assert (scenario.explorer.max_speed, scenario.explorer.rate) == (4.0, 10.0)
    assert scenario.explorer.step_length == Scenario().explorer.step_length
    assert load_scenario(filename=str(path), scenario_name="Other").laps == 5
    scenario = load_scenario(
        filename=str(path),
        scenario_name="Other",
        scenario_text="{laps: 7, systems: {gate_mapper: c:d}, explorer: {rate: 5}}",
    )
    assert scenario.laps == 7 and scenario.seed == 0
    assert scenario.systems == {"explorer": "a:b", "gate_mapper": "c:d"}
    assert scenario.explorer.rate == 5.0
    # No two scenarios share a section.
    assert Scenario().explorer.rate != 5.0 and Scenario().systems == {}


def test_drakes_own_structs_can_be_set():
    scenario = load_scenario(
        scenario_text="""
        simulator_config: {integration_scheme: runge_kutta2, max_step_size: 0.05,
                           target_realtime_rate: 1}
        plant_config: {time_step: 0.002, discrete_contact_approximation: sap}
    """
    )
    scenario.check()
    assert isinstance(scenario.simulator_config, SimulatorConfig)
    assert isinstance(scenario.plant_config, MultibodyPlantConfig)
    assert scenario.simulator_config.integration_scheme == "runge_kutta2"
    assert scenario.simulator_config.target_realtime_rate == 1.0
    assert scenario.plant_config.time_step == 0.002
    assert scenario.plant_config.contact_model == "point"


BAD = {
    "lapse: 3": "lapse is unknown",
    "explorer: {max_sped: 3}": "explorer.max_sped is unknown; there are: rate, max_speed",
    "simulator_config: {acuracy: 1}": "simulator_config.acuracy is unknown",
    "laps: many": "laps must be a whole number, not 'many'",
    "laps: 2.5": "laps must be a whole number, not 2.5",
    "laps: true": "laps must be a whole number",
    "trajectory: 4": "trajectory must be text in quotes, not 4",
    "trajectory: '5'": "trajectory must be one of 3, 4, 6, optimal, not '5'",
    "explorer: 3": "explorer must be a mapping",
    "explorer: {step_length: 0.1}": "explorer.step_length must be at least 0.5, not 0.1",
    "explorer: {expected_gates: 2}": "explorer.expected_gates must be at least 3, not 2",
    "explorer: {expected_gates: 21}": "explorer.expected_gates must be at most perception.max_gates, 20, not 21",
    "{explorer: {expected_gates: 9}, perception: {max_gates: 8}}": "perception.max_gates, 8, not 9",
    "explorer: {expected_gates: ten}": "explorer.expected_gates must be a whole number, not 'ten'",
    "explorer: {max_speed: fast}": "explorer.max_speed must be a number, not 'fast'",
    "systems: {explorer: 3}": "systems.explorer must be text",
    "[1, 2]": "must be a mapping",
    "laps: [": "not valid YAML",
    "laps: 0": "laps must be at least 1, not 0",
    "laps: 1000000": "laps must be at most 1000",
    "seed: -1": "seed must be at least 0",
    "camera: {renderer: crayon}": "camera.renderer must be one of planar, vtk",
    "camera: {width: 100000}": "camera.width must be at most",
    "camera: {fov_y_deg: 180.0}": "camera.fov_y_deg must be at most",
    "camera: {fps: 1.0e-9}": "camera.fps must be at least",
    "state_noise: some": "state_noise must be one of nominal, none",
    "rotors: {rate: 1.0e+12}": "rotors.rate must be at most 10000",
    "referee: {rate: 0.1}": "referee.rate must be at least 1",
    "state_filter: {rate: 0.1}": "state_filter.rate must be at least 1",
    "rotor_monitor: {rate: 1.0e+12}": "rotor_monitor.rate must be at most 10000",
    "state_estimate: {position_sigma: -0.1}": "state_estimate.position_sigma must be at least 0",
    "disturbances: {drag: 11}": "disturbances.drag must be at most 10, not 11",
    "disturbances: {mass_error: 0.6}": "disturbances.mass_error must be at most 0.5",
    "disturbances: {actuator_delay: 1}": "disturbances.actuator_delay must be at most 0.1",
    "disturbances: {drag: 1, wind: {mean: [1, 2, 31]}}": r"disturbances.wind.mean\[2\] must be at most 30, not 31",
    "disturbances: {drag: 1, wind: {mean: [4, 3]}}": "disturbances.wind.mean needs three numbers, x, y and z, not 2",
    "disturbances: {drag: 1, wind: {mean: []}}": "wind.mean needs three numbers",
    "disturbances: {drag: 1, wind: {mean: 4}}": "disturbances.wind.mean must be a list",
    "disturbances: {drag: 1, wind: {mean: [1, 2, up]}}": r"disturbances.wind.mean, number 3, must be a number, not 'up'",
    "disturbances: {wind: {mean: [0, 0, 1]}}": "disturbances.wind acts through drag: set disturbances.drag, e.g. to 1",
    "disturbances: {wind: {gust_rms: 1}}": "disturbances.wind acts through drag",
    "disturbances: {wind: {speed: 1}}": "disturbances.wind.speed is unknown; there are: mean, gust_rms, gust_time, mean_speed",
    "disturbances: {wind: {mean_speed: 4}}": "disturbances.wind acts through drag",
    "disturbances: {drag: 1, wind: {mean_speed: -1}}": "disturbances.wind.mean_speed must be at least 0, not -1",
    "disturbances: {gate_shift: 3}": "disturbances.gate_shift must be at most 2, not 3",
    "controller: {feed_forward: 1}": "controller.feed_forward must be true or false, not 1",
    "controller: {attitude_error: Lee}": "controller.attitude_error must be one of reduced, lee, not 'Lee'",
    "controller: {gains: mine}": "controller.gains must be one of vehicle, original, not 'mine'",
    "rotor_failures: {rotor: 1, time: 1}": "rotor_failures must be a list",
    "rotor_failures: [3]": r"rotor_failure 1 must be a mapping",
    "rotor_failures: [{rotor: 1.5, time: 1}]": r"rotor_failure 1: rotor must be a whole number",
    "rotor_failures: [{number: 1}]": r"rotor_failure 1: number is unknown; there are: rotor, time",
    "rotor_failures: [{rotor: 1}, {time: 3}]": r"rotor_failures\[1\].rotor must be at least 1, not 0",
    "rotor_failures: [{rotor: 1, time: -1}]": r"rotor_failures\[0\].time must be at least 0, not -1",
    "rotor_failures: [{rotor: 2, time: 1}, {rotor: 1}, {rotor: 2, time: 3}]": "rotor_failures has rotor 2 twice; name each rotor once",
    "imu_failures: [{kind: broken}]": r"imu_failures\[0\].kind must be one of lost, nan, stuck, saturated, not 'broken'",
    "imu_failures: [{}, {time: -1}]": r"imu_failures\[1\].time must be at least 0, not -1",
    "imu_failures: [{duration: 0}]": r"imu_failures\[0\].duration must be positive, not 0",
    "imu_failures: [{until: 3}]": r"imu_failure 1: until is unknown; there are: kind, time, duration",
    "imu: {preset: ideal}\nimu_failures: [{kind: saturated}]": r"imu_failures\[0\].kind 'saturated' needs an IMU with ranges: set imu.errors.gyro_range and",
    "camera_failures: [{kind: lost}]": r"camera_failures\[0\].kind must be one of dark, not 'lost'",
    "map: track\ncamera: {renderer: none}\ncamera_failures: [{time: 9}]": "camera_failures need a camera: camera.renderer is 'none'",
    "pilot: learned": "pilot is unknown; its name is policy now",
    "perception: {estimator: robust}": "perception.estimator is unknown; its name is perception.map_estimator now",
    "perception: {map_estimator: best}": "perception.map_estimator must be one of robust, original, not",
    "trajectory: '3'\nplanner: {lap: once}": "planner.lap must be one of periodic, rest_to_rest, not 'once'",
    "planner: {time_allocation: soft}": "planner.time_allocation must be one of exact, original, not 'soft'",
    "planner: {update: never}": "planner.update must be one of if_better, always, not 'never'",
    "planner: {lap: rest_to_rest}": "planner.lap 'rest_to_rest' is for minimum-snap laps: set trajectory .-t. to 3, 4 or 6",
    "planner: {time_allocation: original}": "time_allocation 'original' is for minimum-snap laps: .* at 'exact'",
    "perception: {corners: subpix}": "perception.corners must be one of refit, opencv, not 'subpix'",
    "perception: {poses: both}": "perception.poses must be one of gate, marker, not 'both'",
    "perception: {jump_filter: 1}": "perception.jump_filter must be true or false, not 1",
    "perception: {max_range: 0}": "perception.max_range must be positive, not 0",
    "perception: {max_range: -.inf}": "perception.max_range must be a positive number, not -inf",
    "perception: {max_range: .nan}": "perception.max_range must be a positive number, not nan",
    "perception: {max_range: far}": "perception.max_range must be a number, not 'far'",
    "perception: {min_observations: 0}": "perception.min_observations must be positive, not 0",
    "perception: {outlier_sigma: .inf}": "perception.outlier_sigma must be a finite number, not inf",
    "perception: {map_period: 0}": "perception.map_period must be at least 0.001, not 0",
    "perception: {latency: 0.04}": "perception.latency must be shorter than one frame",
    "referee: {time_limit: 0.0}": "referee.time_limit must be positive",
    "simulator_config: {target_realtime_rate: -1}": "target_realtime_rate",
    "simulator_config: {start_time: 1}": "simulator_config.start_time must be 0",
    "simulator_config: {accuracy: -1}": "simulator_config.accuracy must be positive",
    "simulator_config: {integration_scheme: crystal_ball}": "simulator_config: Unknown integration",
    "plant_config: {time_step: 0}": "plant_config.time_step must be at least 1e-06",
    "plant_config: {time_step: 1e-12}": "plant_config.time_step must be at least 1e-06",
    "plant_config: {contact_model: hydroelastic}": "plant_config.contact_model must be one of",
    "plant_config: {penetration_allowance: -1}": "plant_config: .*penetration_allowance",
    "plant_config: {stiction_tolerance: -1}": "plant_config: .*stiction",
}


@pytest.mark.parametrize("text, words", BAD.items())
def test_bad_values_are_named(text, words):
    message = refusal(scenario_text=text)
    assert re.search(words, message), message


@pytest.mark.slow
def test_every_number_must_be_finite():
    floats = [path for path, value in leaves(document()) if type(value) is float]
    assert len(floats) > 40
    assert {path[0] for path in floats} >= {
        "disturbances",
        "rotor_failures",
        "simulator_config",
        "plant_config",
    }
    for path in floats:
        for value in (math.nan, math.inf):
            if dotted(path) in UNLIMITED:
                continue
            message = refusal(scenario_text=changed(path, value))
            assert message == f"{dotted(path)} must be a finite number, not {value}."


def test_infinite_means_unlimited_and_stays_so():
    scenario = load_scenario(scenario_text="perception: {max_range: .inf}")
    scenario.check()
    data = yaml.safe_load(scenario_yaml(scenario))["Defaults"]
    again = load_scenario(scenario_text=yaml.safe_dump(data))
    assert again.perception.max_range == math.inf


# The numbers of ours that zero is good for.
ZERO = (
    "seed",
    "state_estimate.position_sigma",
    "state_estimate.velocity_sigma",
    "disturbances.wind.mean_speed",
    "disturbances.wind.gust_rms",
    "disturbances.drag",
    "disturbances.mass_error",
    "disturbances.inertia_error",
    "disturbances.thrust_coefficient_error",
    "disturbances.actuator_delay",
    "disturbances.gate_shift",
    "rotor_failures[0].time",
    "imu_failures[0].time",
    "camera_failures[0].time",
    "planner.first_lap_move",
    "planner.first_lap_drag",
    "link_delay",
    *(f"mavlink.quirks.{name}" for name in ("imu_drop", "lost_pictures", "repeated_pictures")),
)
SIGNED = ("disturbances.wind.mean[", "mavlink.quirks.clock_offset")


@pytest.mark.slow
def test_every_number_of_ours_but_noise_and_errors_must_be_positive():
    numbers = {
        dotted(path): path
        for path, value in leaves(document())
        if type(value) in (int, float) and path[0] not in ("simulator_config", "plant_config")
    }
    assert set(ZERO) < set(numbers)
    for name, path in numbers.items():
        if name.startswith(SIGNED):
            load_scenario(scenario_text=changed(path, -1)).check()
            continue
        if name in ZERO:
            load_scenario(scenario_text=changed(path, 0)).check()
        else:
            assert refusal(scenario_text=changed(path, 0)).startswith(f"{name} must be ")
        assert refusal(scenario_text=changed(path, -1)).startswith(f"{name} must be ")


@pytest.mark.slow
def test_switches_are_no_numbers():
    switches = [
        path
        for path, value in leaves(document())
        if type(value) is bool and path[0] not in ("simulator_config", "plant_config")
    ]
    assert len(switches) >= 2
    for path in switches:
        for value in (False, True):
            text = changed(path, value)
            scenario = load_scenario(scenario_text=text)
            scenario.check()
            assert yaml.safe_load(as_yaml(scenario)) == yaml.safe_load(text)
        assert refusal(scenario_text=changed(path, 1)).endswith(
            f"{dotted(path)} must be true or false, not 1."
        )


def test_lists_take_the_place_of_lists(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "Defaults: {rotor_failures: [{rotor: 1, time: 5.0}, {rotor: 2, time: 6.0}],\n"
        "           disturbances: {drag: 1.0, wind: {mean: [1.0, 2.0, 3.0]}}}\n"
    )
    text = "{rotor_failures: [{rotor: 3, time: 7}], disturbances: {wind: {mean: [4, 5, 6]}}}"
    scenario = load_scenario(filename=str(path), scenario_text=text)
    scenario.check()
    assert scenario.rotor_failures == [RotorFailure(3, 7.0)]
    assert scenario.disturbances == DisturbancesConfig(WindConfig([4.0, 5.0, 6.0]), drag=1.0)
    scenario = load_scenario(filename=str(path), scenario_text="rotor_failures: []")
    assert scenario.rotor_failures == [] and scenario.disturbances.drag == 1.0
    assert Scenario().disturbances.wind.mean == [0.0, 0.0, 0.0] and not Scenario().rotor_failures


def test_missing_files_and_names(tmp_path):
    assert "the shipped scenarios are: grand_prix, levels, original, races" in refusal(
        filename="none"
    )
    assert "no 'Nobody' at its top level, only: Defaults, NoNoise" in refusal(
        filename="races", scenario_name="Nobody"
    )
    assert "--scenario_name needs --scenario_file" in refusal(scenario_name="Vtk")
    flat = tmp_path / "flat.yaml"
    flat.write_text("{laps: 3, seed: 1}")
    assert "no 'Defaults' at its top level, only: laps, seed" in refusal(filename=str(flat))


_positive = st.floats(1e-6, 1e6)
_errors = st.floats(0.0, 0.5)
_disturbances = st.builds(
    DisturbancesConfig,
    wind=st.builds(
        WindConfig,
        mean=st.lists(st.floats(-30, 30), min_size=3, max_size=3),
        mean_speed=st.floats(0, 30),
        gust_rms=st.floats(0, 20),
        gust_time=_positive,
    ),
    drag=st.floats(1e-6, 10),
    mass_error=_errors,
    inertia_error=_errors,
    thrust_coefficient_error=_errors,
    actuator_delay=st.floats(0, 0.1),
    gate_shift=st.floats(0, 2),
)
_recordings = st.builds(
    RecordingConfig,
    content=st.sampled_from(CONTENTS),
    state_rate=st.floats(1, 1000),
    pose_rate=st.floats(1, 1000),
    image_rate=st.floats(0.1, 30),
    image_width=st.integers(16, 8192),
    jpeg_quality=st.integers(1, 100),
    flush_period=st.floats(0.01, 60),
)
_failures = st.lists(
    st.builds(RotorFailure, rotor=st.integers(1, 8), time=st.floats(0, 1e6)),
    max_size=3,
    unique_by=lambda failure: failure.rotor,
)
_while = {"time": st.floats(0, 1e6), "duration": st.none() | _positive}
_imu_failures = st.builds(ImuFailure, kind=st.sampled_from(IMU_FAILURES), **_while)
_camera_failures = st.builds(CameraFailure, kind=st.just("dark"), **_while)


_shares = st.floats(0.0, 0.9)
_interfaces = st.builds(
    MavlinkConfig,
    vq=st.sampled_from([1, 2]),
    step=st.booleans(),
    time_limit=_positive,
    jpeg_quality=st.integers(1, 100),
    chunk_size=st.integers(64, 60000),
    quirks=st.builds(
        QuirksConfig,
        imu_drop=_shares,
        lost_pictures=_shares,
        repeated_pictures=_shares,
        clock_offset=st.floats(-1e6, 1e6),
    ),
)


@st.composite
def scenarios(draw):
    """Scenarios with any good value in any field."""
    scenario = Scenario(
        laps=draw(st.integers(1, 1000)),
        seed=draw(st.integers(0, 2**53)),
        trajectory=draw(st.sampled_from("346")),
        state_noise=draw(st.sampled_from(["none", "nominal"])),
        disturbances=draw(_disturbances),
        rotor_failures=draw(_failures),
        imu_failures=draw(st.lists(_imu_failures, max_size=2)),
        camera_failures=draw(st.lists(_camera_failures, max_size=2)),
        recording=draw(_recordings),
        systems=draw(st.dictionaries(st.text(max_size=9), st.text(max_size=9), max_size=2)),
        mavlink=draw(_interfaces),
    )
    for section in SECTIONS:
        if section in ("disturbances", "recording", "mavlink"):
            continue
        config = getattr(scenario, section)
        for name, value in vars(config).items():
            if type(value) is bool:
                setattr(config, name, draw(st.booleans()))
            elif type(value) is float and section not in ("camera", "perception"):
                at_least_1 = name in ("rate", "step_length")
                setattr(config, name, draw(st.floats(1, 1e4) if at_least_1 else _positive))
            elif type(value) is int:
                setattr(config, name, draw(st.integers(16, 256)))
    scenario.planner.thrust_share = draw(st.floats(0.1, 1.0))
    scenario.planner.first_lap_drag = draw(st.floats(0.0, 1.0))
    scenario.planner.limits = draw(st.sampled_from(["original", "rotor", "v=3,a=1.5"]))
    scenario.planner.lap = draw(st.sampled_from(["periodic", "rest_to_rest"]))
    scenario.planner.time_allocation = draw(st.sampled_from(["exact", "original"]))
    scenario.planner.update = draw(st.sampled_from(["if_better", "always"]))
    scenario.camera.preset = draw(st.sampled_from(list(PRESETS)))
    scenario.camera.effects.shutter = draw(st.none() | st.floats(0, 0.03))
    scenario.camera.effects.distortion = draw(
        st.none() | st.lists(st.floats(-1, 1), min_size=5, max_size=5)
    )
    scenario.simulator_config.accuracy = draw(st.floats(1e-9, 1e-1))
    scenario.plant_config.time_step = draw(st.floats(1e-6, 0.01))
    return scenario


@pytest.mark.slow
@given(scenarios())
def test_what_a_run_leaves_loads_again(tmp_path_factory, scenario):
    scenario.check()
    path = tmp_path_factory.getbasetemp() / "scenario.yaml"
    path.write_text(scenario_yaml(scenario))
    assert as_yaml(load_scenario(filename=str(path))) == as_yaml(scenario)


def test_a_left_scenario_finds_its_track_from_any_folder(tmp_path, monkeypatch, hexagon):
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "here" / "mine.yaml").write_text(Path(hexagon).read_text())
    left = tmp_path / "left.yaml"
    left.write_text(scenario_yaml(Scenario(track="mine.yaml")))
    monkeypatch.chdir(tmp_path / "there")
    track = load_scenario(filename=str(left)).track
    assert find_yaml("tracks", track).samefile(tmp_path / "here" / "mine.yaml")
    # A shipped track is found wherever airrace is installed.
    assert yaml.safe_load(scenario_yaml(Scenario()))["Defaults"]["track"] == "student-airrace"


_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 2000)
    | st.floats()
    | st.sampled_from(["3", "vtk", "none", "x", ""]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(
            st.sampled_from(
                [
                    *yaml.safe_load(as_yaml(Scenario())),
                    "rate",
                    "max_speed",
                    "width",
                    "wind",
                    "mean",
                    "drag",
                    "rotor",
                    "time",
                ]
            ),
            inner,
            max_size=3,
        )
    ),
    max_leaves=6,
)


@guarded
@given(_values)
def test_anything_loads_or_is_refused_in_a_sentence(data):
    try:
        scenario = load_scenario(scenario_text=yaml.safe_dump(data))
        scenario.check()
    except UserError as e:
        assert "\n" not in str(e)
    else:
        assert scenario.laps >= 1
        assert all(
            math.isfinite(value)
            for _, value in leaves(yaml.safe_load(as_yaml(scenario)))
            if isinstance(value, float)
        )


@pytest.mark.parametrize(
    "text, words",
    [
        ("{content: all}", "recording.content must be one of none, light, full, not 'all'"),
        ("{image_rate: 31}", "recording.image_rate must be at most camera.fps, 30 Hz, not 31"),
        ("{image_rate: 0}", "recording.image_rate must be at least 0.1"),
        ("{state_rate: .inf}", "recording.state_rate must be a finite number"),
        ("{jpeg_quality: 101}", "recording.jpeg_quality must be at most 100"),
    ],
)
def test_bad_recordings(text, words):
    with pytest.raises(UserError, match=words):
        load_scenario(scenario_text=f"recording: {text}").check()


def test_without_pictures_their_rate_does_not_matter():
    load_scenario(
        scenario_text="{recording: {content: light}, camera: {fps: 2}, perception: {latency: 0.01}}"
    ).check()


def test_numbers_of_numpy_and_paths_are_good(tmp_path):
    track = tmp_path / "mine.yaml"
    track.write_bytes((models_path() / "tracks" / "hexagon.yaml").read_bytes())
    scenario = Scenario(track=track, laps=1.0, seed=np.int64(3))
    scenario.explorer.max_speed, scenario.camera.width = np.float32(4.0), np.int16(640)
    scenario.disturbances.wind.mean = np.zeros(3)
    scenario.check()
    again = load_scenario(
        scenario_text=yaml.dump(yaml.safe_load(scenario_yaml(scenario))["Defaults"])
    )
    assert (again.laps, again.seed, again.explorer.max_speed) == (1, 3, 4.0)
    assert again.track == str(track) and type(scenario.laps) is int
    options = RaceOptions(track=track, laps=np.float64(2.0), scenario_file=Path("races"))
    assert race_scenario(options).laps == 2


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (dict(laps=1.5), "laps must be a whole number, not 1.5"),
        (dict(seed="7"), "seed must be a whole number, not '7'"),
        (dict(track=None), "track must be text in quotes, not None"),
        (dict(trajectory=3), "trajectory must be text in quotes, not 3"),
        (dict(camera=None), "camera must be a CameraConfig, not None"),
        (dict(systems=[]), "systems must be a dict"),
        (dict(explorer=dict(max_speed=3.0)), "explorer must be a ExplorerConfig"),
    ],
)
def test_values_of_python_that_cannot_be_are_named(fields, words):
    with pytest.raises(UserError, match=words):
        Scenario(**fields).check()
