"""How fast a vector environment is stepped, and how that is reported.

This is run by the Python of each simulator's own environment, so it needs numpy and nothing else.
"""

import time

import numpy as np

STEP = 0.02  # s, between two actions
BLOCKS, BLOCK_TIME = 5, 0.6  # of each batch; s of each block, at least


def timed(step, actions, num_envs: int) -> float:
    """Returns steps of all drones together in a second, the median of some blocks.

    Args:
        step: makes a step with the actions of all drones; waits until that is done.
        actions: some arrays of them, which are taken by turns.
        num_envs: how many drones.
    """
    for k in range(3 * len(actions)):  # what compiles is compiled
        step(actions[k % len(actions)])
    rates = []
    for _ in range(BLOCKS):
        count, began = 0, time.perf_counter()
        while time.perf_counter() - began < BLOCK_TIME:
            step(actions[count % len(actions)])
            count += 1
        rates.append(count * num_envs / (time.perf_counter() - began))
    return float(np.median(rates))
