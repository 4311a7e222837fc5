"""Learns to race: a network that flies generated tracks, by proximal policy optimisation (PPO).

    .venv/bin/python -m pip install -e '.[rl,train]'
    .venv/bin/python examples/train_pilot.py
    ./run.bash --pilot runs/pilot/pilot.npz

Schulman et al., "Proximal policy optimization algorithms", 2017, with the advantages of Schulman
et al., "High-dimensional continuous control using generalized advantage estimation", 2016. The
batch of drones flies in machine code, and JAX does the learning, on the CPU. The folder gets
pilot.npz, the network at the best evaluation so far; train_pilot.png, the curves; and
checkpoint.npz, from which --resume goes on.
"""

import argparse
import functools
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from airrace.envs.registration import register_envs
from airrace.systems.control.policy_network import PolicyNetwork
from airrace.vehicle import load_vehicle

GAMMA, LAMBDA = 0.99, 0.95  # of rewards, and of errors in the value, for each step of 20 ms
CLIP = 0.2  # the ratio of probabilities may leave 1 by so much
HIDDEN = (128, 128)
HORIZON = 64  # steps of every drone between two updates
EPOCHS, MINIBATCHES = 3, 8
REWARD_SCALE = 0.1  # so that the values to be learned are about one
# First it learns to be quick, then to be careful as well: what a failure costs more grows from
# nothing to this between two shares of the training.
CAREFUL, CAREFUL_FROM, CAREFUL_TO = 100.0, 0.45, 0.75
JUDGED_EVERY = 2_000_000  # steps
HELD_OUT = 1_000_000  # first seed of the tracks to judge by; training takes those from 0 on


class Rollout(NamedTuple):
    """What N drones did in T steps, each array (T N, ...)."""

    observations: np.ndarray  # normalised
    actions: np.ndarray
    log_probabilities: np.ndarray
    advantages: np.ndarray
    returns: np.ndarray


class Normaliser:
    """Mean and spread of all observations so far, and the bounds of the last ones."""

    def __init__(self, size):
        self.count, self.mean, self.square = 1e-4, np.zeros(size), np.ones(size)
        self.low, self.high = np.full(size, np.inf), np.full(size, -np.inf)

    @property
    def std(self):
        return np.sqrt(np.maximum(self.square - self.mean**2, 1e-4))

    def add(self, observations):
        rows = observations.reshape(-1, observations.shape[-1]).astype(float)
        self.count += len(rows)
        share = len(rows) / self.count
        self.mean += share * (rows.mean(0) - self.mean)
        self.square += share * ((rows**2).mean(0) - self.square)
        low, high = rows.min(0), rows.max(0)
        # Bounds that were reached long ago, by a beginner, are forgotten.
        self.low = np.minimum(low, self.low + 0.02 * np.nan_to_num(low - self.low, neginf=-1e9))
        self.high = np.maximum(high, self.high + 0.02 * np.nan_to_num(high - self.high, posinf=1e9))

    def __call__(self, observations):
        return ((observations - self.mean) / self.std).astype(np.float32)


def make_network(key, sizes, last_scale):
    """Returns layers (W, b) with orthogonal W, the last one small."""
    keys, scales = jax.random.split(key, len(sizes) - 1), [1.4] * (len(sizes) - 2) + [last_scale]
    return [
        (jax.nn.initializers.orthogonal(scale)(k, (m, n)), jnp.zeros(n))
        for k, scale, m, n in zip(keys, scales, sizes, sizes[1:])
    ]


def evaluate_network(layers, x):
    """Returns W_n tanh(... tanh(W_0 x + b_0)) + b_n for every row of x."""
    for W, b in layers[:-1]:
        x = jnp.tanh(x @ W + b)
    W, b = layers[-1]
    return x @ W + b


def log_probability(parameters, observations, actions):
    """Returns the logarithm of the density of actions, up to a constant."""
    mean, log_std = evaluate_network(parameters["policy"], observations), parameters["log_std"]
    return -jnp.sum(0.5 * ((actions - mean) / jnp.exp(log_std)) ** 2 + log_std, axis=-1)


@jax.jit
def act(parameters, observations, key):
    """Returns drawn actions, their log-probabilities, and the values of the observations."""
    mean = evaluate_network(parameters["policy"], observations)
    noise = jax.random.normal(key, mean.shape)
    actions = mean + jnp.exp(parameters["log_std"]) * noise
    values = evaluate_network(parameters["value"], observations)[:, 0]
    return actions, log_probability(parameters, observations, actions), values


act_best = jax.jit(lambda layers, x: jnp.clip(evaluate_network(layers, x), -1.0, 1.0))


def loss(parameters, batch):
    """Returns equation (9) of PPO, to be minimised."""
    ratio = jnp.exp(
        log_probability(parameters, batch.observations, batch.actions) - batch.log_probabilities
    )
    clipped = jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP)
    gain = jnp.minimum(ratio * batch.advantages, clipped * batch.advantages)
    error = evaluate_network(parameters["value"], batch.observations)[:, 0] - batch.returns
    return jnp.mean(0.5 * error**2 - gain)


@functools.partial(jax.jit, static_argnums=0)
def update(optimiser, parameters, state, rollout, key):
    """Returns parameters and the optimiser's state after some epochs over a rollout."""

    def step(carry, indices):
        parameters, state = carry
        batch = jax.tree.map(lambda x: x[indices], rollout)
        a = batch.advantages
        batch = batch._replace(advantages=(a - a.mean()) / (a.std() + 1e-8))
        changes, state = optimiser.update(jax.grad(loss)(parameters, batch), state, parameters)
        return (optax.apply_updates(parameters, changes), state), None

    orders = [
        jax.random.permutation(k, len(rollout.returns)) for k in jax.random.split(key, EPOCHS)
    ]
    batches = jnp.concatenate(orders).reshape(EPOCHS * MINIBATCHES, -1)
    return jax.lax.scan(step, (parameters, state), batches)[0]


def fly(env, observations, parameters, normaliser, key, penalty):
    """Flies HORIZON steps; returns the rollout, the raw observations, and the last ones."""
    T, N = HORIZON, env.num_envs
    raw, rows, rewards, values, ends = [], [], np.empty((T, N)), np.empty((T + 1, N)), []
    for t, k in enumerate(jax.random.split(key, T)):
        seen = normaliser(observations)
        actions, log_probabilities, values[t] = map(np.asarray, act(parameters, seen, k))
        raw.append(observations)
        rows.append((seen, actions, log_probabilities))
        observations, reward, terminated, truncated, info = env.step(np.clip(actions, -1.0, 1.0))
        rewards[t] = REWARD_SCALE * (reward - penalty * terminated)
        if truncated.any():  # it would have gone on
            final = normaliser(info["final_obs"][truncated])
            rewards[t, truncated] += GAMMA * np.asarray(act(parameters, final, k)[2])
        ends.append(terminated | truncated)
    values[T] = act(parameters, normaliser(observations), k)[2]
    advantages, ahead = np.empty((T, N)), np.zeros(N)
    for t in reversed(range(T)):
        goes_on = ~ends[t]
        error = rewards[t] + GAMMA * goes_on * values[t + 1] - values[t]
        ahead = advantages[t] = error + GAMMA * LAMBDA * goes_on * ahead
    arrays = [*map(np.array, zip(*rows)), advantages, advantages + values[:T]]
    flat = [a.reshape(T * N, *a.shape[2:]).astype(np.float32) for a in arrays]
    return Rollout(*flat), np.array(raw), observations, rewards.sum() / REWARD_SCALE / (T * N)


def judge(env, layers, normaliser):
    """Flies a lap of every held-out track; returns the share that finished, and the mean lap."""
    observations, _ = env.reset(seed=0, options={"tracks": np.arange(env.num_envs)})
    alive, laps = np.ones(env.num_envs, bool), np.full(env.num_envs, np.nan)
    while (alive & np.isnan(laps)).any():
        actions = np.asarray(act_best(layers, normaliser(observations)))
        observations, _, terminated, truncated, info = env.step(actions)
        first = alive & np.isnan(laps) & (info["lap_time"] > 0.0)
        laps[first] = info["lap_time"][first]
        alive &= ~(terminated | truncated)
    return np.isfinite(laps).mean(), np.nanmean(laps) if np.isfinite(laps).any() else np.nan


def save_pilot(path, parameters, normaliser, args):
    """Writes the network as `--pilot` and learned_pilot.py read it."""
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+"]
    commit = subprocess.run(git, capture_output=True, text=True).stdout.strip() or "unknown"
    words = " ".join(["examples/train_pilot.py", *sys.argv[1:]])
    weights, biases = zip(*((np.asarray(W).T, np.asarray(b)) for W, b in parameters["policy"]))
    PolicyNetwork(
        weights=weights,
        biases=biases,
        mean=normaliser.mean,
        scale=normaliser.std,
        low=normaliser.low,
        high=normaliser.high,
        gates=2,
        drone=load_vehicle(args.drone)[0].name,
        made_by=f"{words} (commit {commit}, seed {args.seed})",
    ).save(path)


def save_checkpoint(path, learned, rest):
    """Writes arrays of networks and optimiser, and a dict of what else goes on."""
    leaves = {f"leaf_{i}": leaf for i, leaf in enumerate(jax.tree.leaves(learned))}
    np.savez(path, rest=np.array(rest, object), **leaves)


def load_checkpoint(path, learned):
    """Returns what save_checkpoint() wrote, in the shape of what is there now."""
    saved = np.load(path, allow_pickle=True)  # a file of one's own
    leaves, tree = jax.tree.flatten(learned)
    arrays = [jnp.asarray(saved[f"leaf_{i}"]) for i in range(len(leaves))]
    return jax.tree.unflatten(tree, arrays), saved["rest"].item()


def draw_curve(path, rows):
    """Draws (steps, reward a step, share finished, mean lap) of all evaluations."""
    steps, rewards, finished, laps = np.transpose(rows)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.5), layout="constrained")
    titles = "reward a step", "held-out tracks finished (%)", "their mean lap (s)"
    for ax, title, values in zip(axes, titles, (rewards, 100 * finished, laps)):
        ax.plot(steps / 1e6, values)
        ax.set(title=title, xlabel="million steps")
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def make_parser():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=Path("runs/pilot"), help="a folder")
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
    parser.add_argument("--steps", type=float, default=50e6, help="of all drones together")
    parser.add_argument("--envs", type=int, default=512, help="drones that fly at once")
    parser.add_argument("--tracks", type=int, default=100, help="generated ones to train on")
    parser.add_argument("--held-out", type=int, default=100, help="others, to judge by")
    parser.add_argument("--rate", type=float, default=5e-4, help="of learning, at first")
    parser.add_argument("--threads", type=int, default=1, help="of the simulation")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true", help="go on from checkpoint.npz")
    return parser


def main():
    args = make_parser().parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    checkpoint, picture = args.output / "checkpoint.npz", args.output / "train_pilot.png"
    register_envs()
    make = functools.partial(gymnasium.make_vec, "airrace/Race-v0", track="generated",
                             drone=args.drone, num_threads=args.threads)  # fmt: skip
    env = make(num_envs=args.envs, tracks=range(args.tracks), start="random",
               autoreset_mode="SameStep")  # fmt: skip
    judged = make(num_envs=args.held_out, tracks=range(HELD_OUT, HELD_OUT + args.held_out),
                  start="hover", time_limit=120.0)  # fmt: skip
    key, *keys = jax.random.split(jax.random.key(args.seed), 3)
    sizes = [env.single_observation_space.shape[0], *HIDDEN]
    policy = make_network(keys[0], [*sizes, env.single_action_space.shape[0]], 0.01)
    policy[-1] = policy[-1][0], policy[-1][1].at[0].set(env.unwrapped.hover_action[0])
    learned = {
        "policy": policy,
        "value": make_network(keys[1], [*sizes, 1], 1.0),
        "log_std": jnp.full(env.single_action_space.shape, -1.0),
    }
    per_update = HORIZON * args.envs
    updates = max(1, int(args.steps) // per_update)
    slower = optax.linear_schedule(args.rate, 0.1 * args.rate, updates * EPOCHS * MINIBATCHES)
    optimiser = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(slower))
    learned = learned, optimiser.init(learned)
    rest = {"normaliser": Normaliser(sizes[0]), "rows": [], "best": (0.0, 0.0), "spent": 0.0,
            "updates": 0}  # fmt: skip
    if args.resume:
        learned, rest = load_checkpoint(checkpoint, learned)
    began = time.monotonic() - rest["spent"]
    normaliser = rest["normaliser"]
    observations, _ = env.reset(seed=args.seed + rest["updates"])
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns) as progress:
        task = progress.add_task("learning", total=updates, completed=rest["updates"])
        for k in range(rest["updates"], updates):
            parameters, state = learned
            careful = (k / updates - CAREFUL_FROM) / (CAREFUL_TO - CAREFUL_FROM)
            penalty = CAREFUL * float(np.clip(careful, 0.0, 1.0))
            keys = jax.random.split(jax.random.fold_in(key, k))
            flown, raw, observations, reward = fly(
                env, observations, parameters, normaliser, keys[0], penalty
            )
            learned = update(optimiser, parameters, state, flown, keys[1])
            normaliser.add(raw)
            steps = (k + 1) * per_update
            progress.update(task, advance=1, description=f"reward a step {reward:.3f}")
            if k + 1 < updates and steps % JUDGED_EVERY >= per_update:
                continue
            finished, lap = judge(judged, learned[0]["policy"], normaliser)
            rest["spent"], rest["updates"] = time.monotonic() - began, k + 1
            rest["rows"].append((steps, reward, finished, lap))
            progress.console.print(
                f"{steps / 1e6:5.1f} million steps, {rest['spent'] / 60:5.1f} min: reward a step "
                f"{reward:.3f}, {finished:4.0%} finished, lap {lap:.2f} s", soft_wrap=True
            )  # fmt: skip
            # 95 % are enough: then the quicker one is the better one.
            score = min(finished, 0.95), -np.nan_to_num(lap, nan=np.inf)
            if score > rest["best"]:
                rest["best"] = score
                save_pilot(args.output / "pilot.npz", learned[0], normaliser, args)
            draw_curve(picture, rest["rows"])
            save_checkpoint(checkpoint, learned, rest)
    print(f"Picture: {picture.resolve()}")


if __name__ == "__main__":
    main()
