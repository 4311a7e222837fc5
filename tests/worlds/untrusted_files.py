"""The kinds of files that others give you, how to make a sound one, and what reads it."""

import contextlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from airrace.analysis.log import read_log, reading
from airrace.analysis.recorded_events import recorded_events
from airrace.analysis.report import write_report
from airrace.analysis.run import Run
from airrace.common.resources import models_path
from airrace.evaluation.store import RaceStore
from airrace.league.entry import load_entry
from airrace.league.folder_check import (
    check_digests,
    check_flights,
    check_season,
    check_whole,
    load_flown_entries,
)
from airrace.league.league_json import read_league
from airrace.league.season import load_season, make_legs
from airrace.recording.writer import RaceLog
from airrace.scenario import Scenario, load_scenario, scenario_yaml
from airrace.systems.policy.policy_network import load_policy
from airrace.track import load_track
from airrace.track.map_files import read_map, write_map
from airrace.vehicle import load_vehicle
from airrace.visualization.ghosts import record_of
from airrace.visualization.page_sink import PageSink
from airrace.visualization.race_record import RaceRecord, script_json
from tests.evaluation.rows import SETTINGS, row
from tests.league import seasons
from tests.league.entries import make_entry
from tests.worlds.linear_policy import linear_network
from tests.worlds.made_up_run import make_run
from tests.worlds.mutations import mutated_bytes, mutated_json, mutated_yaml
from tests.worlds.untrusted_kind import Kind, WrongResult


def _written(name: str, text: str) -> Callable[[Path], Path]:
    def make(folder):
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return make


def _shipped(name: str) -> Callable[[Path], Path]:
    def make(folder):
        return Path(shutil.copy(models_path() / name, folder))

    return make


def _make_vehicle(folder):
    shutil.copytree(models_path() / "default", folder / "drone")
    return folder / "drone" / "vehicle.yaml"


def _make_map(folder):
    write_map(folder, read_map("track", "hexagon"))
    return folder / "map.json"


def _make_policy(folder):
    linear_network(load_vehicle("Default")[0]).save(folder / "policy.npz")
    return folder / "policy.npz"


def _make_entry(folder):
    return (
        make_entry(folder / "herons", "team: Herons\nautonomy: {trajectory: '3'}\n") / "entry.yaml"
    )


def _make_rows(folder):
    with RaceStore(folder, SETTINGS) as store:
        for seed in range(3):
            store.append(row(seed))
    return folder / "races.jsonl"


def _resume(path):
    with RaceStore(path.parent, SETTINGS, resume=True) as store:
        return store.rows


def _make_settings(folder):
    _make_rows(folder)
    return folder / "evaluation.json"


def _mutate_line(rng, data):
    lines = data.splitlines()
    at = rng.randrange(len(lines))
    lines[at] = mutated_json(rng, lines[at]).replace(b"\n", b" ")
    return b"\n".join(lines) + b"\n"


def _make_unrecorded(folder):
    return make_run(folder / "run", laps=2, recorded=False) / "race.json"


def _make_recorded(folder):
    run = make_run(folder / "run", laps=1)
    Run(run).state.to_pickle(folder / "state")
    return run / "race.mcap"


def _read_log(path):
    run = Run(path.parent)
    if len(run.state) > 1:
        script_json(record_of(run).whole())
    true = pd.read_pickle(path.parent.parent / "state")
    if run.complete and run.damage is None and not run.state.equals(true):
        raise WrongResult("another flight, and no damage")
    return run


def _make_messages(folder):
    """A file of JSON of one message of each topic that is JSON; they become a log."""
    run = make_run(folder / "run", laps=1)
    messages = {
        topic: message for topic, _, message in read_log(run / "race.mcap") if type(message) is dict
    }
    path = run / "messages.json"
    path.write_text(json.dumps(messages))
    return path


def _read_messages(path):
    try:
        messages = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return
    if not isinstance(messages, dict):
        return
    log = RaceLog(path.with_name("race.mcap"))
    for topic, message in messages.items():
        # What cannot be written is in no log.
        with contextlib.suppress(KeyError, TypeError, ValueError):
            log.write(topic, 1.0, message)
    log.close()
    run = Run(path.parent)
    sink = PageSink(RaceRecord(), run.track, run.vehicle)
    for event in recorded_events(run):
        with reading(path, "an event"):
            sink.take(event)
    write_report(path.parent)


def _make_league(folder):
    results = [seasons.result((10.0,)), seasons.result((11.0,))]
    seasons.make_season(folder / "out", {"a": results, "b": results})
    shutil.copy(folder / "out" / "league.json", folder / "true.json")
    return folder / "out" / "league.json"


def _read_league(path):
    league, folder = read_league(path), path.parent
    legs = make_legs(seasons.SEASON, seasons.SECRET)
    entries, doubts = load_flown_entries(folder, league)
    doubts += check_digests(folder, league)
    doubts += check_season(league, seasons.SEASON, seasons.SECRET)
    doubts += check_flights(folder, league)
    doubts += check_whole(league, seasons.SEASON, seasons.SECRET, legs, entries)
    if not doubts and league != json.loads((folder.parent / "true.json").read_text()):
        raise WrongResult("it was edited, and nothing is in doubt")


_SEASON = (
    "name: Spring\nlevels: [1, 2]\ntracks: 3\ngates: 8\nseed_file: s.seed\nlimits: {disk: 1}\n"
)


def _load_scenario(path):
    return load_scenario(filename=str(path))


def _load_policy(path):
    return load_policy(path, load_vehicle("Default")[0])


FILES = (
    Kind("scenario", _written("s.yaml", scenario_yaml(Scenario())), mutated_yaml, _load_scenario),
    Kind("track", _shipped("tracks/hexagon.yaml"), mutated_yaml, lambda p: load_track(str(p))),
    Kind("vehicle", _make_vehicle, mutated_yaml, lambda p: load_vehicle(str(p.parent))),
    Kind("map.json", _make_map, mutated_json, lambda path: read_map(str(path), "hexagon")),
    Kind("race.json", _make_unrecorded, mutated_json, lambda p: write_report(p.parent), True),
    Kind("race.mcap", _make_recorded, mutated_bytes, _read_log, True),
    Kind("messages of race.mcap", _make_messages, mutated_json, _read_messages, True),
    Kind("policy", _make_policy, mutated_bytes, _load_policy),
    Kind("races.jsonl", _make_rows, _mutate_line, _resume),
    Kind("evaluation.json", _make_settings, mutated_json, _resume),
    Kind("league.json", _make_league, mutated_json, _read_league),
    Kind("season", _written("season.yaml", _SEASON), mutated_yaml, load_season),
    Kind("entry", _make_entry, mutated_yaml, lambda path: load_entry(path.parent)),
)
