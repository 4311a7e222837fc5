"""What both sides of a link must share: from wherever the drone's folder is, in few characters."""

import dataclasses as dc
import json
import shutil

import pytest

from airrace.hitl.channels import make_channels
from airrace.hitl.link.partners import Partner, first_difference
from airrace.hitl.shared_settings import shared_settings
from airrace.scenario import Scenario
from airrace.vehicle import find_vehicle


def partner(scenario):
    channels = make_channels(scenario, ("state_estimate",))
    return Partner(shared=shared_settings(scenario, channels))


def test_a_drone_is_the_same_in_another_folder(tmp_path):
    shutil.copytree(find_vehicle("Default").parent, tmp_path / "mine")
    here, there = partner(Scenario()), partner(Scenario(drone=str(tmp_path / "mine")))
    assert here.digest == there.digest != ""
    path = tmp_path / "mine" / "vehicle.yaml"
    path.write_text(path.read_text().replace("mass: 1.0", "mass: 1.1", 1))
    there = partner(Scenario(drone=str(tmp_path / "mine")))
    assert first_difference(there.json, here) == "drone.mass 1.1, here 1.0"
    assert len(here.json) < 8000


@pytest.mark.parametrize(
    "changes, difference",
    [
        ({"estimator": "vio"}, "estimator vio, here truth"),
        ({"drone": "StarOne"}, "drone.name StarOne, here Default"),
        ({"seed": 7, "laps": 3, "track": "elsewhere"}, None),  # the simulation's alone
    ],
)
def test_fields_of_a_scenario(changes, difference):
    here, there = partner(Scenario()), partner(dc.replace(Scenario(), **changes))
    assert (here.digest != there.digest) == (difference is not None)
    if difference:
        assert first_difference(there.json, here) == difference


def test_cameras_and_rates():
    scenario, here = Scenario(), partner(Scenario())
    scenario.camera.renderer = "vtk"
    assert partner(scenario).digest == here.digest
    scenario.camera.width, scenario.controller.rate = 320, 250.0
    there = partner(scenario)
    assert first_difference(there.json, here) == "camera.width 320, here 1280"
    assert json.loads(there.json)["controller.rate"] == 250.0
