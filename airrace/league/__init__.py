"""A league: entries race on hidden tracks, each autonomy in a sandbox of its own.

entry.py and season.py are the two YAML files; scenarios.py says what the simulation is told of a
race, and what the entry. sandbox.py is the sandbox, entry_process.py runs in it, entry_remote.py is
the simulation's end of the link to it. entry_race.py flies one race, worker.py on a worker of Dask,
season_run.py says what all are. ranking.py, season_files.py, page.py and proof.py make of it what
people read and can check.
"""
