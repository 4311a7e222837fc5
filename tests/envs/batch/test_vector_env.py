"""The batch as an environment: the same race as RaceEnv's, and Gymnasium's rules for many."""

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from airrace.common.errors import UserError
from airrace.envs import register_envs
from airrace.envs.batch.lanes import LANES
from airrace.envs.batch.vector_env import RaceVectorEnv
from airrace.envs.reward import REASONS, RUNNING, RewardWeights
from airrace.track.generator import generate_track

register_envs()  # a checkout that is not installed has no plug-ins
N = 12
HOVERING = dict(track="hexagon", start="hover")


def random_actions(env, seed, steps, spread=0.25):
    """Returns actions that carry a drone away, each another way, (steps, n, m)."""
    generator = np.random.default_rng(seed)
    slow = generator.uniform(-1.0, 1.0, (1, *env.action_space.shape))
    quick = generator.uniform(-1.0, 1.0, (steps, *env.action_space.shape))
    return np.clip(env.hover_action + spread * (0.3 * slow + quick), -1.0, 1.0).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        dict(drone="Default", action="ctbr"),
        dict(drone="StarOne", action="ctbr", scenario={"disturbances": {"drag": 1.0}}),
        dict(drone="Default", action="rotors", gates=3),
        dict(
            drone="Default",
            scenario={
                "disturbances": {
                    "drag": 0.5,
                    "actuator_delay": 0.004,
                    "wind": {"mean": [3.0, 1.0, 0.0]},
                }
            },
        ),
    ],
    ids=["Default", "StarOne", "rotors", "delay"],
)
def test_an_episode_is_that_of_the_diagram(options):
    """Observations, rewards and the end, step by step, for some drones."""
    options = HOVERING | options
    batch = RaceVectorEnv(4, **options)
    single = gymnasium.make("airrace/Race-v0", **options)
    actions = random_actions(
        batch, 1, 400, spread=0.05 if options.get("action") == "rotors" else 0.25
    )
    first, _ = batch.reset(seed=0)
    seen = [batch.step(a) for a in actions]
    ends = []
    for i in range(batch.num_envs):
        observation, _ = single.reset(seed=0)
        np.testing.assert_allclose(observation, first[i], atol=1e-6)
        for k in range(len(actions)):
            observation, reward, terminated, truncated, info = single.step(actions[k, i])
            rows, rewards, terminations, truncations, infos = (
                seen[k][0],
                seen[k][1],
                seen[k][2],
                seen[k][3],
                seen[k][4],
            )
            assert (terminated, truncated) == (terminations[i], truncations[i])
            if terminated:
                assert info["reason"] == REASONS[infos["outcome"][i]]
                ends.append(info["reason"])
            if info.get("reason") == "collision":
                break  # Drake's drone bounced
            np.testing.assert_allclose(observation, rows[i], rtol=1e-5, atol=1e-5)
            assert reward == pytest.approx(rewards[i], abs=1e-6)
            assert info["gates_passed"] == infos["gates_passed"][i]
            if terminated or truncated:
                break
    assert len(ends) == batch.num_envs


def test_results_are_the_same_with_any_number_of_threads():
    def flown(threads):
        env = RaceVectorEnv(
            3 * LANES - 5,  # three blocks, the last one not full
            track="generated",
            tracks=range(3),
            start="random",
            level=3,
            num_threads=threads,
        )
        rows = [env.reset(seed=7)[0]]
        for action in random_actions(env, 2, 200, spread=0.6):
            observations, rewards, *_ = env.step(action)
            rows += [observations, rewards]
        env.close()
        return rows

    for one, more in zip(flown(1), flown(3)):
        np.testing.assert_array_equal(one, more)


def test_equal_seeds_give_equal_episodes():
    env = RaceVectorEnv(N, track="generated", tracks=range(4), start="random", level=2)
    rows = []
    for seed in (3, 4, 3):
        observations = [env.reset(seed=seed)[0]]
        actions = random_actions(env, 5, 100, spread=0.6)
        rows.append(np.array(observations + [env.step(a)[0] for a in actions]))
    np.testing.assert_array_equal(rows[0], rows[2])
    assert np.any(rows[0] != rows[1])


def test_next_step_begins_anew_in_the_step_after_the_end():
    env = RaceVectorEnv(N, **HOVERING, time_limit=0.1)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    first, _ = env.reset(seed=0)
    for _ in range(5):
        observations, _, terminated, truncated, _ = env.step(np.zeros((N, 4)))
    assert truncated.all() and not terminated.any()
    observations, rewards, terminated, truncated, info = env.step(np.ones((N, 4)))
    np.testing.assert_array_equal(observations, first)
    assert not (rewards.any() or terminated.any() or truncated.any() or info["time"].any())


def test_same_step_gives_the_final_observation_and_the_first_of_the_next_episode():
    env = RaceVectorEnv(N, **HOVERING, time_limit=0.1, autoreset_mode=AutoresetMode.SAME_STEP)
    first, _ = env.reset(seed=0)
    for _ in range(4):
        last = env.step(np.zeros((N, 4)))[0]
    observations, _, _, truncated, info = env.step(np.zeros((N, 4)))
    assert truncated.all() and info["_final_obs"].all()
    np.testing.assert_array_equal(observations, first)
    assert np.all(np.linalg.norm(info["final_obs"] - last, axis=1) < 3.0)
    assert np.any(info["final_obs"] != first)
    np.testing.assert_allclose(info["final_info"]["time"], 0.1)
    assert not info["time"].any()


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_bad_actions_are_named_and_the_episode_goes_on(number):
    env = RaceVectorEnv(N, **HOVERING)
    env.reset(seed=0)
    actions = np.tile(env.hover_action, (N, 1))
    bad = actions.copy()
    bad[5, 2] = number
    with pytest.raises(ValueError, match="drone 5"):
        env.step(bad)
    with pytest.raises(ValueError, match="shape"):
        env.step(actions[:3])
    _, _, terminated, _, info = env.step(actions)
    assert not terminated.any() and np.all(info["time"] == 0.02)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (dict(action="reference"), "action"),
        (dict(observation="pixels"), "observation"),
        (dict(level=4), "gates cannot move"),
        (dict(autoreset_mode="sometimes"), "NEXT_STEP, SAME_STEP, DISABLED, not 'sometimes'"),
        (dict(num_threads=-1), "num_threads must be a whole number from 1 to"),
        (dict(num_threads=None), "num_threads must be a whole number from 1 to"),
        (dict(max_episode_steps=0), "max_episode_steps must be a whole number from 1"),
        (dict(reward=lambda step: 0.0), "RewardWeights"),
        (dict(strat="pad"), "strat"),
        (dict(clearance=-0.1), "clearance"),
        (dict(clearance=math.nan), "clearance"),
    ],
)
def test_what_a_batch_cannot_do_is_said(options, said):
    with pytest.raises(UserError, match=said):
        RaceVectorEnv(2, **options)


@pytest.mark.parametrize("count", [-1, 0, 2.5, "4", None, True])
def test_a_number_of_drones_that_cannot_be_is_said(count):
    with pytest.raises(UserError, match="num_envs must be a whole number from 1 to"):
        RaceVectorEnv(count, track="hexagon")


@pytest.mark.parametrize("mode", ["SAME_STEP", "SameStep", AutoresetMode.SAME_STEP])
def test_a_mode_has_the_names_of_gymnasium(mode):
    env = RaceVectorEnv(np.int64(2), track="hexagon", autoreset_mode=mode)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP and env.num_envs == 2


def test_an_episode_has_at_most_so_many_steps():
    env = gymnasium.make_vec("airrace/Race-v0", num_envs=2, **HOVERING, max_episode_steps=3)
    env.reset(seed=0)
    ends = [env.step(np.zeros((2, 4)))[3].all() for _ in range(3)]
    assert ends == [False, False, True]


def test_nothing_is_flown_before_reset_or_after_close():
    for threads in (1, 2):
        env = RaceVectorEnv(2 * LANES, **HOVERING, num_threads=threads)
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
            env.step(np.zeros((2 * LANES, 4)))
        env.reset(seed=0)
        env.close()
        env.close()
        for call in (env.reset, lambda: env.step(np.zeros((2 * LANES, 4)))):
            with pytest.raises(gymnasium.error.ClosedEnvironmentError):
                call()


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_a_mask_begins_some_episodes_and_the_others_fly_on(mode):
    env = RaceVectorEnv(3, **HOVERING, time_limit=0.1, autoreset_mode=mode)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    first, _ = env.reset(seed=0)
    for _ in range(3):
        seen = env.step(np.zeros((3, 4)))[0]
    again, info = env.reset(options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(again[1], first[1])
    np.testing.assert_array_equal(again[[0, 2]], seen[[0, 2]])
    np.testing.assert_array_equal(info["_time"], [False, True, False])
    env.step(np.zeros((3, 4)))
    *_, truncated, _ = env.step(np.zeros((3, 4)))
    np.testing.assert_array_equal(truncated, [True, False, True])
    if mode == "DISABLED":
        with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[0, 2\]"):
            env.step(np.zeros((3, 4)))
        env.reset(options={"reset_mask": truncated})
    *_, truncated, _ = env.step(np.zeros((3, 4)))
    assert not truncated.any()


@pytest.mark.parametrize("step", [0.02, 0.1, 0.5])
def test_an_arc_over_a_gate_is_no_passage_however_long_a_step_is(step):
    """As of RaceEnv: the chord from one end of half a second to the other leads through."""
    env = RaceVectorEnv(1, **HOVERING, step=step, reward=RewardWeights(rates=0.0))
    env.reset(seed=0)
    env._fleet.state[0] = [1, 0, 0, 0, -3.0, -25.0, 11.7, 0, 0, 0, 15.0, 0.0, 3.0]
    env._fleet.before[0] = env._fleet.state[0, 4:7]
    for _ in range(round(0.5 / step)):
        _, _, terminated, _, info = env.step(np.array([[-1.0, 0.0, 0.0, 0.0]]))
        if terminated[0]:
            break
    assert REASONS[info["outcome"][0]] == "missed gate" and info["gates_passed"][0] == 0


def test_the_first_contact_ends_a_step_however_long_it_is():
    def fallen(step):
        env = RaceVectorEnv(1, **HOVERING, step=step, reward=RewardWeights(rates=0.0))
        env.reset(seed=0)
        value, terminated = 0.0, [False]
        while not terminated[0]:
            _, rewards, terminated, _, info = env.step(np.array([[-1.0, 0.0, 0.0, 0.0]]))
            value += rewards[0]
        return env._fleet.state[0, 4:7].copy(), value, REASONS[info["outcome"][0]]

    position, value, reason = fallen(0.5)
    expected, expected_value, _ = fallen(0.02)
    assert reason == "collision" and value == pytest.approx(expected_value)
    np.testing.assert_allclose(position, expected, atol=1e-9)


def test_make_vec_finds_it():
    env = gymnasium.make_vec("airrace/Race-v0", num_envs=3, track="hexagon")
    assert isinstance(env.unwrapped, RaceVectorEnv)
    observations, _ = env.reset(seed=0)
    assert env.observation_space.contains(observations)


def test_a_drone_that_is_to_keep_clear_may_take_off_but_not_come_down_again():
    env = RaceVectorEnv(1, track="hexagon", clearance=0.6)
    env.reset(seed=0)
    up, down = (np.array([[thrust, 0.0, 0.0, 0.0]]) for thrust in (0.2, -0.8))
    for _ in range(40):
        _, _, terminated, _, _ = env.step(up)
        assert not terminated[0]
    while not terminated[0]:
        _, _, terminated, _, info = env.step(down)
    assert REASONS[info["outcome"][0]] == "collision"
    lowest = env._fleet.state[0, 6] - env._world.shape.standing_height
    assert 0.3 < lowest < 0.6


def test_the_pad_holds_the_drone_until_it_lifts_off():
    env = RaceVectorEnv(2, track="hexagon")
    env.reset(seed=0)
    for _ in range(20):
        observations, _, terminated, _, info = env.step(np.tile([-1.0, 0, 0, 0], (2, 1)))
    assert not terminated.any() and not observations[:, :3].any()
    for _ in range(50):
        observations, _, terminated, _, _ = env.step(np.tile([0.2, 0, 0, 0], (2, 1)))
    assert not terminated.any() and np.all(observations[:, 2] > 1.0)


def test_a_lap_of_teleports_is_timed():
    """Gate after gate, by drones that are put in front of each."""
    env = RaceVectorEnv(1, track="hexagon", start="hover", laps=1, time_limit=60.0)
    env.reset(seed=0)
    fleet, gates = env._fleet, env._world.courses.gates[0]
    steps = 0
    for k in range(len(gates) + 1):
        gate = gates[k % len(gates)]
        fleet.state[0, 4:7] = fleet.before[0] = gate[:3] - 0.1 * gate[3:6]
        fleet.state[0, 10:13] = 10.0 * gate[3:6]
        _, reward, terminated, _, info = env.step(env.hover_action[None])
        steps += 1
        assert reward[0] > 9.0 and info["gates_passed"][0] == k + 1
    assert terminated[0] and REASONS[info["outcome"][0]] == "finished"
    assert info["lap_time"][0] == pytest.approx(0.02 * len(gates), abs=1e-6)


def test_generated_tracks_are_those_of_their_seeds():
    env = RaceVectorEnv(3, track="generated", tracks=[5, 6], start="hover")
    env.reset(seed=0, options={"tracks": [1, 0, 1]})
    for i, seed in enumerate((6, 5, 6)):
        start = generate_track(seed).start.position
        np.testing.assert_allclose(env._fleet.state[i, 4:6], start[:2])
    assert RUNNING == 0
