"""The environment: Gymnasium's contract, equal episodes, and the ways in which they end."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pydrake.math import RigidTransform

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.envs import ID, action, race_env
from airrace.envs.options import OBSERVATIONS
from airrace.envs.race_env import RaceEnv
from airrace.envs.reward import RewardWeights
from airrace.envs.start import FlyingStart

COMBINATIONS = [(a, o) for a in action.KINDS for o in OBSERVATIONS]
# Flies the drone to a place by references.
FLY = dict(action="reference", time_limit=60.0)


@pytest.fixture(scope="module")
def env():
    """An environment for whoever needs one that is as usual."""
    with RaceEnv() as env:
        yield env


def fly_to(env, places, steps=900):
    """Flies by references to one place after the other; returns the last step's result."""
    for place in places:
        for _ in range(steps):
            away = np.array(place) - env.unwrapped.true_state[4:7]
            if np.linalg.norm(away) < 1.0:
                break
            wanted = np.zeros(7)
            wanted[:3] = away / max(np.linalg.norm(away), 1e-9) * min(np.linalg.norm(away) / 5, 0.4)
            result = env.step(wanted)
            if result[2] or result[3]:
                return result
    return result


def flown(env, seed, steps=40):
    """Returns all that is seen in an episode of random actions."""
    first, info = env.reset(seed=seed)
    rng, seen = np.random.default_rng(1), [first]
    for _ in range(steps):
        # Enough thrust to leave the pad at once.
        act = rng.uniform(-0.3, 0.3, env.action_space.shape)
        *result, _ = env.step(act)
        seen.append(np.append(result[0], result[1:]))
        if result[2] or result[3]:
            break
    return np.hstack(seen), info


@pytest.mark.slow
@pytest.mark.parametrize("kind, seen", COMBINATIONS)
def test_gymnasium_finds_no_fault(kind, seen):
    # A vision system that looks at pictures as small as these would find no marker.
    with RaceEnv(action=kind, observation=seen, render_mode="rgb_array") as env:
        check_env(env, skip_render_check=False)


@pytest.mark.slow
def test_gymnasium_finds_no_fault_in_other_worlds():
    options = dict(drone="StarOne", track="generated", level=4, start="random", action="rotors")
    with RaceEnv(**options) as env:
        check_env(env)


@pytest.mark.slow
def test_an_estimate_by_vio_is_checked():
    with RaceEnv(observation="estimate", scenario={"estimator": "vio"}) as env:
        check_env(env)


def test_it_is_made_by_its_name():
    with gymnasium.make(ID, gates=3) as env:
        first, info = env.reset(seed=3)
        assert first.shape == (15 + 36 + 4,)
        assert info["action_scale"]["center"][0] == pytest.approx(17.0)


def test_an_import_registers_it_without_drake():
    code = (
        "import gymnasium, sys, airrace.envs; gymnasium.spec('airrace/Race-v0'); "
        "assert 'pydrake' not in sys.modules; "
        "gymnasium.make('airrace.envs:airrace/Race-v0').close()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("level", [0, 3])
def test_equal_seeds_give_equal_episodes_whatever_was_flown_before(level):
    options = dict(level=level, start="random")
    with RaceEnv(**options) as one, RaceEnv(**options) as other:
        flown(one, 5, steps=20)
        flown(one, 6, steps=3)
        (seen, info), (again, info_again) = flown(one, 7), flown(other, 7)
        np.testing.assert_array_equal(seen, again)
        assert info["episode_seed"] == info_again["episode_seed"]
        later = one.reset()[0], other.reset()[0]
        np.testing.assert_array_equal(*later)
        assert not np.array_equal(later[0], seen[: len(later[0])])


def test_another_seed_is_another_drone():
    """From the pad, where nothing but its mass and rotors differ."""
    with RaceEnv(level=2, scenario={"state_noise": "none"}) as env:
        heights = []
        for seed in (1, 2, 1):
            env.reset(seed=seed)
            for _ in range(30):
                env.step([1, 0, 0, 0])
            heights.append(env.true_state[6])
    assert heights[0] == heights[2] and abs(heights[0] - heights[1]) > 1e-3


def test_a_generated_track_is_a_new_one_each_episode():
    with RaceEnv(track="generated") as env:
        names = [env.reset(seed=2)[1]["track"], env.reset()[1]["track"]]
        assert names[0] != names[1]
        assert env.reset(seed=2)[1]["track"] == names[0]


@pytest.mark.parametrize("bad", [np.full(4, np.nan), np.zeros(3), [0, 0, np.inf, 0]])
def test_what_is_no_action_leaves_the_episode_as_it_is(env, bad):
    env.reset(seed=1)
    expected = [env.step(np.full(4, 0.2))[0] for _ in range(3)][-1]
    env.reset(seed=1)
    for _ in range(3):
        with pytest.raises(ValueError, match="The action must"):
            env.step(bad)
        seen = env.step(np.full(4, 0.2))[0]
    np.testing.assert_array_equal(seen, expected)


def test_what_is_beyond_one_counts_as_one(env):
    env.reset(seed=1)
    expected = env.step(np.ones(4))[0]
    env.reset(seed=1)
    np.testing.assert_array_equal(env.step(np.full(4, 7.0))[0], expected)


def test_a_step_after_the_end():
    with RaceEnv(time_limit=0.04) as env:
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(np.zeros(4))
        env.reset(seed=0)
        assert env.step(-np.ones(4))[2:4] == (False, False)
        assert env.step(-np.ones(4))[2:4] == (False, True)
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
            env.step(np.zeros(4))


def test_the_ground_is_a_collision(env):
    env.reset(seed=0)
    for k in range(200):
        act = np.array([0.5 if k < 30 else -1.0, 0, 0, 0])
        *_, terminated, _, info = result = env.step(act)
        if terminated:
            break
    assert info["reason"] == "collision" and info["collision"] == "hit the ground"
    assert result[1] < -9.0


def test_a_gate_and_then_a_pylon():
    with RaceEnv(**FLY) as env:  # gate 1 is at x = 20 m
        env.reset(seed=0)
        info = fly_to(env, [(0, 0, 5), (22, 0, 6)])[4]
        assert info["gates_passed"] == 1 and info["next_gate"] == 2
        *_, terminated, _, info = fly_to(env, [(24, 5, 5), (19.5, 5, 5)])
        assert terminated and info["collision"].startswith("touched")


def test_a_gate_missed():
    with RaceEnv(**FLY) as env:
        env.reset(seed=0)
        _, value, terminated, _, info = fly_to(env, [(0, 0, 5), (15, 9, 5), (25, 9, 5)])
        assert terminated and info["reason"] == "missed gate" and value < -9.0


def test_the_arena_left():
    with RaceEnv(**FLY, scenario={"referee": {"arena_margin": 8.0}}) as env:
        env.reset(seed=0)
        _, _, terminated, _, info = fly_to(env, [(0, 0, 9.5)])
        assert terminated and info["reason"] == "left the arena"


def test_a_reward_of_ones_own():
    with RaceEnv(reward=lambda step: 3.0 + step.after[6] - step.before[6]) as env:
        env.reset(seed=0)
        seen = [env.step([1, 0, 0, 0])[1] for _ in range(20)]
        assert seen[0] == pytest.approx(3.0, abs=0.01) and seen[-1] > 3.01


def test_a_random_start_is_in_front_of_its_gate():
    with RaceEnv(start="random") as env:
        for seed in range(10):
            first, info = env.reset(seed=seed)
            corners = first[15:27].reshape(4, 3)
            assert np.all(corners[:, 0] > 1.0)  # ahead
            assert corners[0, 1] > 0.0 > corners[1, 1]  # left, right
            assert info["gates_passed"] == 0
            assert not env.step(np.zeros(4))[2]


@pytest.mark.slow
def test_gates_that_are_not_in_the_map_have_no_corners():
    with RaceEnv(observation="estimate") as env:
        first, _ = env.reset(seed=0)
        assert not first[15:39].any()
    with RaceEnv(observation="estimate", scenario={"map": "track"}) as env, RaceEnv() as truth:
        np.testing.assert_allclose(env.reset(seed=0)[0], truth.reset(seed=0)[0], atol=1e-5)


def test_pictures_have_the_size_of_choice():
    with RaceEnv(observation="pixels", image_size=(48, 64)) as env:
        first, _ = env.reset(seed=0)
        assert first["image"].shape == (48, 64, 3) and np.ptp(first["image"]) > 50


def test_what_the_camera_sees_is_rendered():
    with RaceEnv(render_mode="rgb_array") as env:
        env.reset(seed=0)
        assert env.render().shape == (360, 640, 3)


@pytest.mark.slow
def test_a_page_shows_the_episodes(capsys):
    with RaceEnv(render_mode="human") as env:
        for _ in range(2):
            env.reset(seed=0)
            env.step(np.zeros(4))
            assert env.render() is None
    assert capsys.readouterr().out.count("http://") == 1  # one page for all


@pytest.mark.parametrize(
    "options, words",
    [
        ({"action": "thrust"}, "action must be one of ctbr, rotors, reference"),
        ({"observation": "state"}, "observation must be one of gates, estimate, pixels"),
        ({"start": "air"}, "start must be one of pad, hover, random"),
        ({"level": 5}, "level must be a whole number from 0 to 4"),
        ({"level": "1"}, "level must be a whole number from 0 to 4"),
        ({"image_size": 3}, "image_size must be (height, width)"),
        ({"track": 3}, "track must be text"),
        ({"gate": 2}, "no option 'gate', but gates; there are: action"),
        ({"gates": 0}, "gates must be a whole number from 1 to 20"),
        ({"laps": 1.5}, "laps must be a whole number"),
        ({"step": 0.003}, "step must be a multiple of the period"),
        ({"time_limit": float("nan")}, "time_limit must be a positive number"),
        ({"track": "nowhere"}, "nowhere"),
        ({"drone": "nothing"}, "no drone named 'nothing'"),
        ({"render_mode": "ansi"}, "render_mode must be one of human, rgb_array"),
        ({"scenario": {"lap": 3}}, "lap"),
        ({"scenario": {"estimator": "vio"}}, "is for the observation 'estimate'"),
        ({"reward": 3.0}, "reward must be RewardWeights"),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(UserError) as error:
        RaceEnv(**options)
    assert words in str(error.value)


LONG = dict(track="hexagon", start="hover", reward=RewardWeights(rates=0.0))


def fallen(step):
    """Returns reason, state and reward at the end of a fall from the hover, with steps so long."""
    with RaceEnv(**LONG, step=step) as env:
        env.reset(seed=0)
        value, terminated = 0.0, False
        while not terminated:
            _, reward, terminated, _, info = env.step([-1.0, 0.0, 0.0, 0.0])
            value += reward
        return info["collision"], env.true_state, value


def test_the_first_contact_ends_a_step_however_long_it_is():
    for step in (0.1, 0.5):
        (said, state, value), (_, expected, expected_value) = fallen(step), fallen(0.02)
        assert said == "hit the ground" and value == pytest.approx(expected_value)
        np.testing.assert_array_equal(state, expected)


@pytest.mark.parametrize("step", [0.02, 0.1, 0.5])
def test_a_gate_is_missed_on_an_arc_over_it_however_long_a_step_is(step, monkeypatch):
    """The chord from one end of half a second to the other leads through the gate."""
    X_WB = RigidTransform([-3.0, -25.0, 11.7])
    start = FlyingStart(0, X_WB, np.zeros(3), np.array([15.0, 0.0, 3.0]))
    monkeypatch.setattr(race_env, "hover_start", lambda track: start)
    with RaceEnv(**LONG, step=step) as env:
        env.reset(seed=0)
        for _ in range(round(0.5 / step)):
            *_, terminated, _, info = env.step([-1.0, 0.0, 0.0, 0.0])
            if terminated:
                break
    assert info["reason"] == "missed gate" and info["gates_passed"] == 0


@pytest.mark.parametrize("track", ["hexagon", "generated"])
def test_it_may_be_closed_twice_and_reset_after(track):
    env = RaceEnv(track=track)
    first = env.reset(seed=1)[0]
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(4))
    np.testing.assert_array_equal(env.reset(seed=1)[0], first)
    env.close()


def test_there_is_no_picture_before_the_first_episode():
    with RaceEnv(render_mode="rgb_array") as env, pytest.raises(gymnasium.error.ResetNeeded):
        env.render()


def test_numbers_of_numpy_and_paths_are_options(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes((models_path() / "tracks" / "hexagon.yaml").read_bytes())
    options = dict(track=path, laps=np.int64(1), gates=2.0, level=np.int32(0))
    with RaceEnv(**options, step=np.float32(0.5), time_limit=3) as env:
        assert env.reset(seed=0)[0].shape == (43,)


@pytest.mark.parametrize("reward", [None, "much", float("nan"), [1.0, 2.0]])
def test_a_reward_that_is_no_number_is_named(reward):
    def mine(step):
        return reward

    with RaceEnv(reward=mine) as env:
        env.reset(seed=0)
        with pytest.raises(UserError, match=r"The reward .*mine\(\) gave .*a finite number"):
            env.step(np.zeros(4))
