"""Learns to race: a network that flies generated tracks, by proximal policy optimisation (PPO).

    .venv/bin/python -m pip install -e '.[train]'
    .venv/bin/python examples/train_policy.py
    ./run.bash --policy runs/policy/policy.npz

Schulman et al., "Proximal policy optimization algorithms", 2017, with the advantages of Schulman
et al., "High-dimensional continuous control using generalized advantage estimation", 2016. The
drones fly in machine code, and JAX learns, on the CPU. The folder gets policy.npz, the best network
so far, train_policy.png, and checkpoint.npz, from which --resume goes on.
"""

import argparse
import functools
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
from rich.progress import track

from airrace.systems.policy.policy_network import PolicyNetwork
from airrace.vehicle import load_vehicle

GAMMA, LAMBDA, CLIP = 0.99, 0.95, 0.2  # of a step of 20 ms; the last: of the ratio, see loss()
HIDDEN, HORIZON = (128, 128), 64  # the last: steps of every drone between two updates
EPOCHS, MINIBATCHES, RATE = 3, 8, 5e-4  # the last: of learning, at first
REWARD_SCALE = 0.1  # so that the values to be learned are about one
LEAST_LOG_STD = -2.5  # of actions: without any noise, nothing is learned
CLEARANCE = 0.4  # m, nearer to anything is a failure in training: what it learns keeps a distance
NEW = 0.03  # share in the running mean of the networks, which is what is judged and kept
# First it learns to be quick, then, between two shares of the training, to be careful as well:
CAREFUL, CAREFUL_SHARES = 60.0, (0.4, 0.7)  # what a failure costs more at last
JUDGED_EVERY, HELD_OUT = 2_000_000, 1_000_000  # steps; first seed of the tracks to judge by

# What N drones did in T steps, each array (T N, ...); observations are normalised.
Rollout = namedtuple("Rollout", "observations actions log_probabilities advantages returns")


class Normaliser:
    """Mean and spread of all observations so far, and the bounds of the last ones."""

    def __init__(self, size):
        self.mean, self.square, self.std, self.count = np.zeros(size), *np.ones((2, size)), 0
        self.low, self.high = np.full(size, np.inf), np.full(size, -np.inf)

    def add(self, rows):
        rows = rows.reshape(-1, rows.shape[-1]).astype(float)
        self.count += len(rows)
        share, low, high = len(rows) / self.count, rows.min(0), rows.max(0)
        self.mean += share * (rows.mean(0) - self.mean)
        self.square += share * ((rows**2).mean(0) - self.square)
        self.std = np.sqrt(np.maximum(self.square - self.mean**2, 1e-4))
        # Bounds that were reached long ago, by a beginner, are forgotten.
        self.low = np.where(low < self.low, low, self.low + 0.02 * (low - self.low))
        self.high = np.where(high > self.high, high, self.high + 0.02 * (high - self.high))

    def __call__(self, observations):
        return ((observations - self.mean) / self.std).astype(np.float32)


def make_network(key, sizes, last_scale):
    """Returns layers (W, b) with orthogonal W, the last one scaled."""
    scales = [1.4] * (len(sizes) - 2) + [last_scale]
    return [
        (jax.nn.initializers.orthogonal(scale)(k, (m, n)), jnp.zeros(n))
        for k, scale, m, n in zip(jax.random.split(key, len(scales)), scales, sizes, sizes[1:])
    ]


def evaluate_network(layers, x):
    """Returns W_n tanh(... tanh(W_0 x + b_0)) + b_n for every row of x."""
    *hidden, (W_n, b_n) = layers
    for W, b in hidden:
        x = jnp.tanh(x @ W + b)
    return x @ W_n + b_n


def log_probability(parameters, observations, actions):
    """Returns the logarithm of the density of actions, up to a constant."""
    mean = evaluate_network(parameters["policy"], observations)
    log_std = jnp.maximum(parameters["log_std"], LEAST_LOG_STD)
    return -jnp.sum(0.5 * ((actions - mean) / jnp.exp(log_std)) ** 2 + log_std, axis=-1)


@jax.jit
def act(parameters, observations, key):
    """Returns drawn actions, their log-probabilities, and the values of the observations."""
    mean = evaluate_network(parameters["policy"], observations)
    std = jnp.exp(jnp.maximum(parameters["log_std"], LEAST_LOG_STD))
    actions = mean + std * jax.random.normal(key, mean.shape)
    values = evaluate_network(parameters["value"], observations)[:, 0]
    return actions, log_probability(parameters, observations, actions), values


def loss(parameters, batch):
    """Returns equation (9) of PPO, to be minimised."""
    log_p = log_probability(parameters, batch.observations, batch.actions)
    ratio, a = jnp.exp(log_p - batch.log_probabilities), batch.advantages
    a = (a - a.mean()) / (a.std() + 1e-8)
    gain = jnp.minimum(ratio * a, jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP) * a)
    error = evaluate_network(parameters["value"], batch.observations)[:, 0] - batch.returns
    return jnp.mean(0.5 * error**2 - gain)


@functools.partial(jax.jit, static_argnums=0)
def update(optimiser, learned, rollout, key):
    """Returns parameters and the optimiser's state after some epochs over a rollout."""

    def step(learned, indices):
        gradient = jax.grad(loss)(learned[0], jax.tree.map(lambda x: x[indices], rollout))
        changes, state = optimiser.update(gradient, learned[1])
        return (optax.apply_updates(learned[0], changes), state), None

    keys = jax.random.split(key, EPOCHS)
    orders = jnp.array([jax.random.permutation(k, len(rollout.returns)) for k in keys])
    return jax.lax.scan(step, learned, orders.reshape(EPOCHS * MINIBATCHES, -1))[0]


def fly(env, observations, parameters, normaliser, key, cost):
    """Flies HORIZON steps; returns the rollout, the observations as seen, and the last ones."""
    T, N = HORIZON, env.num_envs
    rows, rewards, values, ends = [], np.empty((T, N)), np.empty((T + 1, N)), np.empty((T, N), bool)
    for t, k in enumerate(jax.random.split(key, T)):
        seen = normaliser(observations)
        actions, log_probabilities, values[t] = map(np.asarray, act(parameters, seen, k))
        rows.append((observations, seen, actions, log_probabilities))
        observations, reward, terminated, truncated, info = env.step(np.clip(actions, -1.0, 1.0))
        rewards[t] = REWARD_SCALE * (reward - cost * terminated)
        if truncated.any():  # it would have gone on
            ahead = act(parameters, normaliser(info["final_obs"]), k)[2]
            rewards[t] += GAMMA * truncated * np.asarray(ahead)
        ends[t] = terminated | truncated
    values[T] = act(parameters, normaliser(observations), k)[2]
    advantages, ahead = np.empty((T, N)), np.zeros(N)
    for t in reversed(range(T)):
        error = rewards[t] + GAMMA * ~ends[t] * values[t + 1] - values[t]
        ahead = advantages[t] = error + GAMMA * LAMBDA * ~ends[t] * ahead
    raw, *arrays = [*map(np.array, zip(*rows)), advantages, advantages + values[:T]]
    rollout = Rollout(*(a.reshape(T * N, *a.shape[2:]).astype(np.float32) for a in arrays))
    return rollout, raw, observations


def judge(env, policy, normaliser):
    """Flies a lap of every held-out track; returns the share that finished, and the mean lap."""
    observations, _ = env.reset(seed=0, options={"tracks": np.arange(env.num_envs)})
    alive, laps = np.ones(env.num_envs, bool), np.full(env.num_envs, np.nan)
    evaluate = jax.jit(evaluate_network)
    while (alive & np.isnan(laps)).any():
        actions = np.asarray(evaluate(policy, normaliser(observations)))
        observations, _, terminated, truncated, info = env.step(actions)
        laps = np.where(alive & np.isnan(laps), info["lap_time"], laps)
        alive &= ~(terminated | truncated)
    finished = np.isfinite(laps)
    return finished.mean(), laps[finished].mean() if finished.any() else np.inf


def save_policy(path, policy, normaliser, args):
    """Writes the network as `--policy` reads it."""
    git = f"git -C {Path(__file__).parent} describe --always --dirty=+"
    words = " ".join(["examples/train_policy.py", *sys.argv[1:]])
    weights, biases = zip(*((np.asarray(W).T, np.asarray(b)) for W, b in policy))
    PolicyNetwork(
        *(weights, biases, normaliser.mean, normaliser.std, normaliser.low, normaliser.high),
        gates=2,
        drone=load_vehicle(args.drone)[0].name,
        made_by=f"{words} (commit {subprocess.getoutput(git)}, seed {args.seed})",
    ).save(path)


def draw(path, rows):
    """Draws (steps, share finished, mean lap) of all evaluations."""
    steps, finished, laps = np.transpose(rows)
    figure, axes = plt.subplots(1, 2, num=1, clear=True, figsize=(9, 3.5), layout="constrained")
    for ax, title, values in zip(axes, ("finished (%)", "mean lap (s)"), (100 * finished, laps)):
        ax.plot(steps / 1e6, values)
        ax.set(title=f"Held-out tracks: {title}", xlabel="million steps")
    figure.savefig(path, dpi=120)


def main(args):
    (folder := Path(args.output)).mkdir(parents=True, exist_ok=True)
    checkpoint, picture = folder / "checkpoint.npz", folder / "train_policy.png"
    common = dict(track="generated", drone=args.drone, num_threads=args.threads)
    make = functools.partial(gymnasium.make_vec, "airrace.envs:airrace/Race-v0", **common)
    trained = dict(tracks=range(args.tracks), start="random", clearance=CLEARANCE)
    env = make(args.envs, **trained, autoreset_mode="SameStep")
    judged = make(args.held_out, tracks=range(HELD_OUT, HELD_OUT + args.held_out), start="hover")
    key, *keys = jax.random.split(jax.random.key(args.seed), 3)
    sizes, actions = [*env.single_observation_space.shape, *HIDDEN], env.single_action_space.shape
    policy = make_network(keys[0], [*sizes, *actions], 0.01)
    policy[-1] = policy[-1][0], policy[-1][1].at[0].set(env.unwrapped.hover_action[0])
    parameters = {"policy": policy, "value": make_network(keys[1], [*sizes, 1], 1.0)}
    parameters["log_std"] = jnp.full(actions, -1.0)
    updates = max(1, int(args.steps) // (HORIZON * args.envs))
    rate = optax.linear_schedule(RATE, 0.05 * RATE, updates * EPOCHS * MINIBATCHES)
    optimiser = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(rate))
    learned, average = (parameters, optimiser.init(parameters)), policy
    first, normaliser, rows, best = 0, Normaliser(sizes[0]), [], (0.0, -np.inf)
    if args.resume:
        saved, tree = np.load(checkpoint, allow_pickle=True), jax.tree.structure((learned, average))
        leaves = [saved[f"leaf_{i}"] for i in range(tree.num_leaves)]
        learned, average = jax.tree.unflatten(tree, leaves)
        first, normaliser, rows, best = saved["rest"]
    observations, _ = env.reset(seed=args.seed + first)
    for k in track(range(first, updates), "Learning"):
        cost = float(np.interp(k / updates, CAREFUL_SHARES, (0.0, CAREFUL)))
        keys = jax.random.split(jax.random.fold_in(key, k))
        rollout, raw, observations = fly(env, observations, learned[0], normaliser, keys[0], cost)
        learned = update(optimiser, learned, rollout, keys[1])
        average = optax.incremental_update(learned[0]["policy"], average, NEW)
        normaliser.add(raw)
        steps = (k + 1) * HORIZON * args.envs
        if k + 1 < updates and steps % JUDGED_EVERY >= HORIZON * args.envs:
            continue
        finished, lap = judge(judged, average, normaliser)
        rows.append((steps, finished, lap))
        print(f"{steps / 1e6:5.1f} million steps: {finished:4.0%} finished, lap {lap:.2f} s")
        if (score := (min(finished, 0.98), -lap)) >= best:  # 98 % are enough, then the quicker
            best = score
            save_policy(folder / "policy.npz", average, normaliser, args)
        draw(picture, rows)
        rest = np.array([k + 1, normaliser, rows, best], object)
        leaves = {f"leaf_{i}": leaf for i, leaf in enumerate(jax.tree.leaves((learned, average)))}
        np.savez(checkpoint, rest=rest, **leaves)
    print(f"Picture: {picture.resolve()}")


if __name__ == "__main__":
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    for name, default, text in (
        ("output", "runs/policy", "a folder"),
        ("drone", "Default", "a shipped drone, or a folder"),
        ("steps", 50e6, "of all drones together"),
        ("envs", 512, "drones that fly at once"),
        ("tracks", 400, "generated ones to train on"),
        ("held-out", 200, "others, to judge by"),
        ("threads", 2, "of the simulation"),
        ("seed", 0, "of all that is drawn at random"),
    ):
        parser.add_argument(f"--{name}", type=type(default), default=default, help=text)
    parser.add_argument("--resume", action="store_true", help="go on from checkpoint.npz")
    main(parser.parse_args())
