"""Rows of races that nobody flew."""


def row(
    seed,
    *,
    finished=True,
    laps=(20.0, 21.0),
    explored=True,
    reason="ran out of time",
    collisions=0,
    length=400.0,
):
    """A row as fly() returns it."""
    return {
        "seed": seed,
        "gates": 10,
        "length_m": length,
        "result": {
            "track": "t",
            "finished": finished,
            "dnf_reason": None if finished else reason,
            "exploration": {"success": explored, "time_s": 70.0 + seed, "gates_found": 10},
            "laps": [
                {"lap": k, "time_s": time, "map_rms_m": 0.01 * k} for k, time in enumerate(laps, 1)
            ],
            "mean_lap_s": sum(laps) / len(laps) if laps else None,
            "best_lap_s": min(laps, default=None),
            "collisions": collisions,
        },
        "stderr": None,
        "wall": {"seconds": 10.0, "real_time_factor": 1.0},
    }


SETTINGS = {
    "tracks": 4,
    "track_seed": 0,
    "track": "generated tracks",
    "scenario_name": "Level1",
    "scenario": {"drone": "Default", "trajectory": "6", "laps": 2, "referee": {"margin": 60.0}},
}
