"""Reinforcement learning: the race as environments of Gymnasium.

The import registers them: since its version 1, Gymnasium looks for no plug-ins. Nothing of Drake is
imported. See docs/learning.md::

    import gymnasium

    import airrace.envs

    gymnasium.register_envs(airrace.envs)  # says that the import is of use
    env = gymnasium.make("airrace/Race-v0")
"""

import importlib.util

ID = "airrace/Race-v0"


def register_envs() -> None:
    """Tells Gymnasium of the environments, once; the import of this package calls it."""
    from gymnasium.envs.registration import register, registry

    if ID not in registry:
        register(
            id=ID,
            entry_point="airrace.envs.race_env:RaceEnv",
            vector_entry_point="airrace.envs.batch.vector_env:RaceVectorEnv",
            order_enforce=True,
        )


if importlib.util.find_spec("gymnasium"):  # of the extra `rl`
    register_envs()
