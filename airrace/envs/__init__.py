"""Reinforcement learning: the race as environments of Gymnasium.

The import registers them: since its version 1, Gymnasium looks for no plug-ins. Nothing of Drake is
imported. See docs/learning.md::

    import gymnasium

    import airrace.envs

    gymnasium.register_envs(airrace.envs)  # says that the import is of use
    env = gymnasium.make("airrace/Race-v0")
"""

import importlib.util

from airrace.envs.registration import register_envs

if importlib.util.find_spec("gymnasium"):  # of the extra `rl`
    register_envs()
