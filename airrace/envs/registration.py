"""Tells Gymnasium of the environments."""

ID = "airrace/Race-v0"


def register_envs() -> None:
    """Registers the environments, once; an import of airrace.envs calls it.

    Nothing of Drake is imported before one is made.
    """
    from gymnasium.envs.registration import register, registry

    if ID in registry:
        return
    register(
        id=ID,
        entry_point="airrace.envs.race_env:RaceEnv",
        vector_entry_point="airrace.envs.batch.vector_env:RaceVectorEnv",
        order_enforce=True,
    )
