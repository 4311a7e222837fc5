"""crazyflow's own environment, a drone that flies to a goal, stepped at 50 Hz on the CPU.

PYTHON_WITH_CRAZYFLOW -m benchmarks.peers.step_crazyflow ENVS ...

A step is 10 of its simulation at 500 Hz, with the dynamics fitted to attitude commands that its
environments have by default, observations, reward and resets.
"""

import functools
import json
import sys
from importlib.metadata import version

import jax
import numpy as np
from crazyflow.envs import ReachPosEnv

from benchmarks.peers import circle, steps


def step(env, action) -> None:
    """Makes a step, and waits until it is done."""
    jax.block_until_ready(env.step(action)[:4])


def main() -> None:
    """Prints the steps a second of every batch size, as JSON."""
    circle.on_one_core()
    rates = {}
    for num_envs in map(int, sys.argv[1:]):
        env = ReachPosEnv(num_envs=num_envs, freq=round(1.0 / steps.STEP))
        env.reset(seed=0)
        env.action_space.seed(0)
        hover = np.zeros(env.action_space.shape, np.float32)
        hover[:, 3] = 0.5 * (env.single_action_space.low[3] + env.single_action_space.high[3])
        actions = [hover + 0.05 * env.action_space.sample() for _ in range(16)]
        rates[num_envs] = steps.timed(functools.partial(step, env), actions, num_envs)
    print(json.dumps({"simulator": f"crazyflow {version('crazyflow')}", "rates": rates}))


if __name__ == "__main__":
    main()
