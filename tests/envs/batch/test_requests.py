"""What a batch is asked for: indices that machine code may use, and sentences for all else."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from airrace.common.errors import UserError
from airrace.envs.batch import requests
from airrace.envs.batch.vector_env import RaceVectorEnv

BAD_TRACKS = [[10**6] * 4, [-1] * 4, [0, 1], [0.5] * 4, [[0] * 4], ["a"] * 4, 1, [True] * 4]


@pytest.mark.parametrize("tracks", BAD_TRACKS)
def test_tracks_that_there_are_not(tracks):
    with pytest.raises(ValueError, match="tracks must be"):
        requests.reset_request({"tracks": tracks}, 4, 2)


def test_a_batch_lives_on_after_tracks_that_there_are_not():
    env = RaceVectorEnv(4, track="hexagon", start="hover")
    first, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="tracks must be from 0 to 0"):
        env.reset(options={"tracks": [10**6] * 4})
    np.testing.assert_array_equal(env.reset(seed=0)[0], first)


@pytest.mark.parametrize("mask", [[True, False], np.array([1, 0]), "all"])
def test_a_mask_of_another_kind(mask):
    with pytest.raises(TypeError, match="reset_mask must be an array of bool"):
        requests.reset_request({"reset_mask": mask}, 2, 1)


@pytest.mark.parametrize("mask", [np.zeros(2, bool), np.ones(3, bool), np.ones((2, 1), bool)])
def test_a_mask_of_another_shape(mask):
    with pytest.raises(ValueError, match="reset_mask must have the shape"):
        requests.reset_request({"reset_mask": mask}, 2, 1)


def test_what_is_asked_for():
    request = requests.reset_request(None, 3, 2)
    np.testing.assert_array_equal(request.drones, [0, 1, 2])
    assert request.tracks is None
    mask = np.array([True, False, True])
    request = requests.reset_request({"reset_mask": mask, "tracks": (1, 0, 1)}, 3, 2)
    np.testing.assert_array_equal(request.drones, [0, 2])
    np.testing.assert_array_equal(request.tracks, [1, 0, 1])
    assert requests.autoreset_mode("DISABLED") is AutoresetMode.DISABLED


def test_an_option_that_there_is_not():
    with pytest.raises(UserError, match="no option 'track', but tracks; there are: tracks"):
        requests.reset_request({"track": [0]}, 1, 1)


@pytest.mark.parametrize("options", [{1: 2}, 5, ["tracks"]])
def test_options_that_are_no_names(options):
    with pytest.raises(UserError, match=r"The options of reset\(\) must be a dict by names"):
        requests.reset_request(options, 2, 1)
