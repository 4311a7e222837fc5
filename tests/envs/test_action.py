"""Actions: their kinds, and what is refused."""

import re

import numpy as np
import pytest

from airrace.common.errors import UserError
from airrace.envs.action import KINDS, action_scale, check_action
from airrace.systems.policy.command_scale import scaled
from airrace.vehicle import load_vehicle

VEHICLES = {name: load_vehicle(name)[0] for name in ("Default", "StarOne")}


@pytest.mark.parametrize("drone, sizes", [("Default", (4, 4, 7)), ("StarOne", (4, 8, 7))])
def test_sizes(drone, sizes):
    assert [len(action_scale(kind, VEHICLES[drone]).center) for kind in KINDS] == list(sizes)


def test_rotors_go_from_rest_to_their_greatest_speed():
    vehicle = VEHICLES["StarOne"]
    scale = action_scale("rotors", vehicle)
    np.testing.assert_array_equal(scaled(-np.ones(8), scale), np.zeros(8))
    np.testing.assert_allclose(scaled(np.ones(8), scale), vehicle.max_speeds)


def test_an_unknown_kind():
    with pytest.raises(UserError, match="must be one of ctbr, rotors, reference, not 'thrust'"):
        action_scale("thrust", VEHICLES["Default"])


@pytest.mark.parametrize(
    "action, words",
    [
        (np.zeros(3), "must have the shape (4,), not (3,)"),
        (np.zeros((4, 1)), "must have the shape (4,), not (4, 1)"),
        (0.0, "must have the shape (4,), not ()"),
        ([0.0, np.nan, 0.0, 0.0], "must be finite numbers"),
        ([0.0, np.inf, 0.0, 0.0], "must be finite numbers"),
        ("forward", "must be an array of numbers"),
        (None, "must have the shape (4,)"),
    ],
)
def test_what_is_no_action(action, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        check_action(action, (4,))
