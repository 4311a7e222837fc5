"""Learns to race: a network that flies generated tracks, by proximal policy optimisation (PPO).

    .venv/bin/python -m pip install -e '.[rl,train]'
    .venv/bin/python examples/train_pilot.py --output runs/pilot
    ./run.bash --pilot runs/pilot/pilot.npz

Schulman et al., "Proximal policy optimization algorithms", 2017, with the advantages of Schulman
et al., "High-dimensional continuous control using generalized advantage estimation", 2016. The
batch of drones flies in machine code, and JAX does the learning, on the CPU. The folder gets
pilot.npz, the network at the best evaluation so far; curve.png; and checkpoint.npz, from which
--resume goes on.
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

GAMMA, LAMBDA = 0.99, 0.95  # of rewards, and of errors in the value, for each step of 20 ms
CLIP = 0.2  # the ratio of probabilities may leave 1 by so much
HIDDEN = (128, 128)
HORIZON = 64  # steps of every drone between two updates
EPOCHS, MINIBATCHES = 3, 8
REWARD_SCALE = 0.1  # so that the values to be learned are about one
# First it learns to be quick, then to be careful as well: what a failure costs more grows from
# nothing to this between two shares of the training.
CAREFUL, CAREFUL_FROM, CAREFUL_TO = 100.0, 0.45, 0.75
STEPS_PER_EVALUATION = 2_000_000
HELD_OUT = range(1_000_000, 1_000_100)  # seeds of tracks to judge by; training takes small ones


class Rollout(NamedTuple):
    """What N drones did in T steps, each array (T, N, ...), or (T N, ...) for the update."""

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
        return np.clip((observations - self.mean) / self.std, -10.0, 10.0).astype(np.float32)


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
    """Flies one lap of every held-out track; returns the share that finished, and lap times."""
    observations, _ = env.reset(seed=0, options={"tracks": np.arange(env.num_envs)})
    alive, laps = np.ones(env.num_envs, bool), np.full(env.num_envs, np.nan)
    while (alive & np.isnan(laps)).any():
        actions = np.asarray(act_best(layers, normaliser(observations)))
        observations, _, terminated, truncated, info = env.step(actions)
        first = alive & np.isnan(laps) & (info["lap_time"] > 0.0)
        laps[first] = info["lap_time"][first]
        alive &= ~(terminated | truncated)
    return np.isfinite(laps).mean(), laps


def save_pilot(path, parameters, normaliser, args):
    """Writes the network in the format of airrace/systems/control/policy_network.py."""
    layers = {
        f"{name}{i}": np.asarray(array)
        for i, layer in enumerate(parameters["policy"])
        for name, array in zip("Wb", layer)
    }
    git = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+"]
    done = subprocess.run(git, capture_output=True, text=True)
    np.savez_compressed(
        path,
        **layers,
        obs_mean=normaliser.mean,
        obs_std=normaliser.std,
        obs_low=normaliser.low,
        obs_high=normaliser.high,
        drone=args.drone,
        command=" ".join(["examples/train_pilot.py", *sys.argv[1:]]),
        commit=done.stdout.strip() or "unknown",
        seed=args.seed,
    )


def draw_curve(path, rows):
    """Draws (steps, seconds, reward a step, share finished, lap) of all evaluations."""
    steps, _, rewards, finished, laps = np.transpose(rows)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.5), layout="constrained")
    titles = "reward a step", "held-out tracks finished (%)", "their mean lap (s)"
    for ax, title, values in zip(axes, titles, (rewards, 100 * finished, laps)):
        ax.plot(steps / 1e6, values)
        ax.set(title=title, xlabel="million steps")
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=Path("runs/pilot"), help="a folder")
    parser.add_argument("--drone", default="Default", help="a shipped drone, or a folder")
    parser.add_argument("--steps", type=float, default=60e6, help="of all drones together")
    parser.add_argument("--envs", type=int, default=512, help="drones that fly at once")
    parser.add_argument("--tracks", type=int, default=200, help="generated ones to train on")
    parser.add_argument("--rate", type=float, default=5e-4, help="of learning, at first")
    parser.add_argument("--threads", type=int, default=1, help="of the simulation")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true", help="go on from checkpoint.npz")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    make = functools.partial(
        gymnasium.make_vec, "airrace/Race-v0", drone=args.drone, num_threads=args.threads
    )
    env = make(
        num_envs=args.envs,
        track="generated",
        tracks=range(args.tracks),
        start="random",
        autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP,
    )
    judged = make(num_envs=len(HELD_OUT), track="generated", tracks=HELD_OUT, start="hover",
                  time_limit=120.0)  # fmt: skip
    inputs, outputs = (space.shape[0] for space in
                       (env.single_observation_space, env.single_action_space))  # fmt: skip
    key, *keys = jax.random.split(jax.random.key(args.seed), 3)
    parameters = {
        "policy": make_network(keys[0], [inputs, *HIDDEN, outputs], 0.01),
        "value": make_network(keys[1], [inputs, *HIDDEN, 1], 1.0),
        "log_std": jnp.full(outputs, -1.0),
    }
    W, b = parameters["policy"][-1]
    parameters["policy"][-1] = W, b.at[0].set(env.unwrapped.hover_action[0])
    per_update = HORIZON * args.envs
    updates = int(args.steps) // per_update
    optimiser = optax.chain(
        optax.clip_by_global_norm(0.5),
        optax.adam(
            optax.linear_schedule(args.rate, 0.1 * args.rate, updates * EPOCHS * MINIBATCHES)
        ),
    )
    state = optimiser.init(parameters)
    normaliser, rows, best, spent = Normaliser(inputs), [], (0.0, 0.0), 0.0
    first = 0
    checkpoint = args.output / "checkpoint.npz"
    if args.resume:
        saved = np.load(checkpoint, allow_pickle=True)
        leaves, tree = jax.tree.flatten((parameters, state))
        parameters, state = jax.tree.unflatten(
            tree, [saved[f"leaf{i}"] for i in range(len(leaves))]
        )
        normaliser, rows, best, spent, first = saved["rest"].item().values()
    began = time.monotonic() - spent
    observations, _ = env.reset(seed=args.seed + first)
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns) as progress:
        task = progress.add_task("learning", total=updates, completed=first)
        for k in range(first, updates):
            careful = (k / updates - CAREFUL_FROM) / (CAREFUL_TO - CAREFUL_FROM)
            penalty = CAREFUL * float(np.clip(careful, 0.0, 1.0))
            keys = jax.random.fold_in(key, 2 * k)
            rollout, raw, observations, reward = fly(
                env, observations, parameters, normaliser, keys, penalty
            )
            parameters, state = update(
                optimiser, parameters, state, rollout, jax.random.fold_in(key, 2 * k + 1)
            )
            normaliser.add(raw)
            steps = (k + 1) * per_update
            last = k + 1 == updates
            if last or steps // STEPS_PER_EVALUATION > k * per_update // STEPS_PER_EVALUATION:
                finished, laps = judge(judged, parameters["policy"], normaliser)
                lap, spent = (
                    float(np.nanmean(laps)) if finished else np.nan,
                    time.monotonic() - began,
                )
                rows.append((steps, spent, reward, finished, lap))
                progress.console.print(
                    f"{steps / 1e6:5.1f} million steps, {spent / 60:5.1f} min: reward a step "
                    f"{reward:.3f}, {finished:4.0%} of held-out tracks finished, lap {lap:.2f} s"
                )
                # 95 % are enough: then the quicker one is the better one.
                if finished and (score := (min(finished, 0.95), -lap)) > best:
                    best = score
                    save_pilot(args.output / "pilot.npz", parameters, normaliser, args)
                draw_curve(args.output / "curve.png", rows)
                rest = dict(normaliser=normaliser, rows=rows, best=best, spent=spent, first=k + 1)
                leaves = jax.tree.leaves((parameters, state))
                np.savez(checkpoint, rest=np.array(rest, object),
                         **{f"leaf{i}": leaf for i, leaf in enumerate(leaves)})  # fmt: skip
            progress.update(task, advance=1, description=f"reward a step {reward:.3f}")


if __name__ == "__main__":
    main()
