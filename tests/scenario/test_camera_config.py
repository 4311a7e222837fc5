"""Presets of the camera, and what takes their place."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from airrace.common.errors import UserError
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.race import MakeRace
from airrace.diagrams.simulation import MakeSimulation
from airrace.rendering.imaging.camera_effects import CameraEffects
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.scenario import Scenario, load_scenario
from airrace.scenario.camera_config import PRESETS
from airrace.track import load_track


def loaded(text):
    scenario = load_scenario(scenario_text=f"{{camera: {text}}}")
    scenario.check()
    return scenario


def first_picture(text):
    """Returns the camera's first picture, its info, and the camera's pose X_WC."""
    simulation = MakeSimulation(loaded(text))
    context = simulation.CreateDefaultContext()
    simulation.GetInputPort("rotor_speed_command").FixValue(context, np.zeros(4))
    Simulator(simulation, context).Initialize()
    outputs = [simulation.GetOutputPort(name) for name in ("camera_image", "camera_info")]
    image, info = (port.Eval(context) for port in outputs)
    plant = simulation.GetSubsystemByName("plant")
    X_WB = plant.GetBodyByName("body").EvalPoseInWorld(plant.GetMyContextFromRoot(context))
    return image.data.copy(), info, X_WB @ info.X_BC


def test_clean_pictures_are_the_renderers():
    image, info, X_WC = first_picture("{preset: clean}")
    ideal = np.zeros_like(image)
    PlanarRenderer(load_track("student-airrace"), info).render(X_WC, ideal)
    assert np.array_equal(image, ideal)
    assert not info.D.any()


@pytest.mark.slow
def test_presets_differ_more_and_more():
    clean, *others = (first_picture(f"{{preset: {name}}}") for name in PRESETS)
    mild, strong = (np.abs(image.astype(int) - clean[0]).mean() for image, *_ in others)
    assert 1 < mild < strong / 3
    assert not others[0][1].D.any()  # as the reference's camera
    assert np.array_equal(others[1][1].D, PRESETS["harsh"].distortion)


def test_realistic_is_the_default():
    assert Scenario().camera.resolved() == PRESETS["realistic"]
    assert PRESETS["clean"] == CameraEffects()


def test_effects_take_the_place_of_the_presets():
    camera = loaded("{preset: clean, effects: {shutter: 0.008}}").camera
    assert camera.resolved() == CameraEffects(shutter=0.008)
    camera = loaded("{preset: harsh, effects: {distortion: [0, 0, 0, 0, 0], latency: 0}}").camera
    assert camera.resolved().distortion == (0, 0, 0, 0, 0)
    assert camera.resolved().latency == 0
    assert camera.resolved().read_noise == PRESETS["harsh"].read_noise


def test_the_seed_is_that_of_the_noise():
    pictures = []
    for seed in (0, 0, 1):
        scenario = Scenario(seed=seed)
        simulation = MakeSimulation(scenario)
        context = simulation.CreateDefaultContext()
        pictures.append(simulation.GetOutputPort("camera_image").Eval(context).data.copy())
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize(
    "text, words",
    [
        ("{preset: dreamy}", "camera.preset must be one of clean, realistic, harsh, not 'dreamy'"),
        ("{effects: {shutter: -0.001}}", "camera.effects.shutter must be at least 0"),
        ("{effects: {shutter: 0.04}}", "camera.effects.shutter must be shorter than one frame"),
        ("{effects: {latency: 0.04}}", "camera.effects.latency must be shorter than one frame"),
        ("{preset: harsh, fps: 90}", "camera.effects.latency must be shorter .* it is 0.02 s"),
        ("{effects: {gain: 0}}", "camera.effects.gain must be at least 0.05, not 0"),
        ("{effects: {vignetting: 1.5}}", "camera.effects.vignetting must be at most 1"),
        ("{effects: {read_noise: .nan}}", "camera.effects.read_noise must be a finite number"),
        ("{effects: {distortion: [0.1]}}", "camera.effects.distortion must be five finite"),
        (
            "{effects: {distortion: [.inf, 0, 0, 0, 0]}}",
            r"distortion\[0\] must be a finite number, not inf",
        ),
        ("{effects: {distortion: 0.1}}", "camera.effects.distortion must be a list"),
        ("{effects: {blur: 1}}", "camera.effects.blur is unknown; there are: shutter, gain"),
    ],
)
def test_bad_values_are_named(text, words):
    with pytest.raises(UserError, match=words) as e:
        loaded(text)
    assert "\n" not in str(e.value)


def test_impossible_lenses_are_refused():
    scenario = loaded("{effects: {distortion: [-0.9, 0, 0, 0, 0]}}")
    with pytest.raises(UserError, match="camera.effects.distortion folds"):
        MakeSimulation(scenario)


@pytest.mark.slow
def test_a_rectifier_stands_before_every_box_if_the_lens_distorts():
    autonomy = MakeAutonomy(loaded("{preset: harsh}"))
    rectifier = autonomy.GetSubsystemByName("rectifier")
    fed = set()
    for (box, i), (source, o) in autonomy.connection_map().items():
        name = box.get_input_port(i).get_name()
        if name in ("camera_image", "camera_grey", "camera_view", "camera_info"):
            assert source is rectifier and source.get_output_port(o).get_name() == name
            fed.add((box.get_name(), name))
    assert {("aruco_detector", "camera_view"), ("aruco_detector", "camera_info")} <= fed
    inputs = {autonomy.get_input_port(i).get_name() for i in range(autonomy.num_input_ports())}
    assert inputs == {  # of pictures, what somebody reads
        "camera_view",
        "camera_image_time",
        "camera_info",
        "state_estimate",
        "rotor_speeds",
        "rotor_status",
    }
    assert not any(
        system.get_name() == "rectifier" for system in MakeAutonomy(Scenario()).GetSystems()
    )
    # It has the same inputs and outputs, so that the race is wired as ever.
    MakeRace(loaded("{preset: harsh}"))
