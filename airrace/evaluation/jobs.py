"""What an evaluation flies: one RaceJob a race."""

import dataclasses as dc
import hashlib
from collections.abc import Sequence

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import UserError
from airrace.common.files import files_in
from airrace.common.resources import find_yaml
from airrace.evaluation.versions import versions
from airrace.evaluation.worker import RaceJob
from airrace.scenario import Scenario
from airrace.track import Track, load_track
from airrace.track.generator import generate_track
from airrace.vehicle import DRONES, find_vehicle

_MAX_DRONE = 20e6  # bytes of a drone's folder, which goes to the workers with every race


def make_jobs(
    scenario: Scenario, seeds: Sequence[int], tracks: Sequence[tuple[Track, str]]
) -> list[RaceJob]:
    """Returns the races of an evaluation.

    Args:
        scenario: checked; its seed and track are replaced.
        tracks: pairs of a Track and its YAML, one a race.

    Raises UserError if the drone's folder is too large.
    """
    drone = {} if scenario.drone in DRONES else _drone_files(scenario.drone)
    flying = versions(scenario.systems)
    track = Scenario().track
    return [
        RaceJob(
            seed=seed,
            track=text,
            gates=len(track_.gates),
            length=_length(track_),
            drone=drone,
            systems=dict(scenario.systems),
            versions=flying,
            scenario=yaml_dump_typed(
                dc.replace(scenario, seed=seed, track=track), schema=Scenario, child_name="Defaults"
            ),
        )
        for seed, (track_, text) in zip(seeds, tracks, strict=True)
    ]


def given_track(name_or_file: str) -> tuple[Track, str]:
    """Returns a track that somebody made, and its YAML; see load_track()."""
    path = find_yaml("tracks", name_or_file)
    return load_track(name_or_file, markers=True), path.read_text("utf-8")


def generated_track(seed: int, gates: int | None = None) -> tuple[Track, str]:
    """Returns the generated track of a seed, and its YAML; gates: see generate_track().

    Raises UserError if there is none.
    """
    track = generate_track(seed, gates)
    return track, yaml_dump_typed(track, schema=Track)


def settings(jobs: list[RaceJob], *, track: str, scenario_name: str) -> dict:
    """Returns what must be equal for two evaluations to be the same.

    Args: track: where the tracks come from. scenario_name: where the scenario comes from.
    """
    races = [(job.track, job.scenario, sorted(job.drone.items())) for job in jobs]
    scenario = yaml.safe_load(jobs[0].scenario)["Defaults"]
    for name in ("seed", "track"):
        del scenario[name]
    return {
        "tracks": len(jobs),
        "track_seed": jobs[0].seed,
        "track": track,
        "scenario_name": scenario_name,
        "scenario": scenario,
        "versions": jobs[0].versions,
        "races_sha256": hashlib.sha256(repr(races).encode()).hexdigest(),
    }


def _length(track: Track) -> float:
    midpoints = np.array([gate.p_WG for gate in track.gates])
    return float(np.linalg.norm(np.roll(midpoints, -1, axis=0) - midpoints, axis=1).sum())


def _drone_files(drone: str) -> dict:
    folder = find_vehicle(drone).parent
    files = files_in(folder)
    if sum(path.stat().st_size for path in files) > _MAX_DRONE:
        raise UserError(
            f"The drone's folder {folder} holds more than {_MAX_DRONE / 1e6:.0f} MB, too much to "
            "send with every race; leave only the drone's own files in it."
        )
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
