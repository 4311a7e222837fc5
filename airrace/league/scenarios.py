"""A race of a season as two scenarios: all of it for the simulation, and what an entry may know.

The two agree in all that both sides compute with: rates, the drone, the camera, the autonomy. The
entry's has no track, no seed, and nothing of what is drawn: with a seed and airrace's own code it
could draw the noise, and the track, itself.
"""

import dataclasses as dc
from typing import NamedTuple

from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.evaluation.jobs import given_track
from airrace.league.entry import Entry
from airrace.league.season import Leg, Season
from airrace.scenario import LEARNED, NO_POLICY, VIO, Scenario, load_scenario
from airrace.track import Track

SCENARIO, TRACK, ENTRY = "scenario.yaml", "track.yaml", "entry"  # names of files and folder
_SAMPLE = "hexagon"  # whose gates an entry is given: everybody knows them
# What an entry is told of a race beside its own settings.
_PUBLIC = ("drone", "laps", "camera", "imu", "rotors", "plant_config", "state_estimate")


class Flown(NamedTuple):
    """A race of an entry."""

    scenario: str  # YAML of the Scenario of the simulation; its track is in TRACK
    entry_scenario: str  # YAML of the Scenario of the entry, whose track is in TRACK beside it
    entry_track: str  # YAML of that track, of which only the hover height is true


def make_flown(season: Season, leg: Leg, entry: Entry) -> Flown:
    """Returns what is flown when an entry flies a race of a season.

    Raises UserError if the entry does not keep the season's rules.
    """
    scenario = race_scenario(season, leg, entry)
    hover_height = load_yaml(Track, data=leg.track, what="the track").hover_height
    track = dc.replace(given_track(_SAMPLE)[0], hover_height=hover_height)
    told = entry_scenario(scenario)
    return Flown(_dump(scenario), _dump(told), yaml_dump_typed(track, schema=Track))


def race_scenario(season: Season, leg: Leg, entry: Entry) -> Scenario:
    """Returns the checked scenario of the simulation; see make_flown()."""
    config = entry.config
    if config.drone not in season.drones:
        raise UserError(
            f"The entry {entry.name} flies {config.drone}; this season is for "
            f"{' and '.join(season.drones)}."
        )
    estimator = config.autonomy.estimator or season.estimator
    if season.estimator == VIO and estimator != VIO:
        raise UserError(
            f"The entry {entry.name} wants to be told where it is; in this season nobody is: "
            "leave out autonomy.estimator."
        )
    scenario = load_scenario(
        filename="levels", scenario_name=f"Level{leg.level}", scenario_text=season.scenario_text
    )
    autonomy, policy = {**vars(config.autonomy)}, config.autonomy.policy
    autonomy["estimator"] = estimator
    autonomy["policy"] = policy if policy in (NO_POLICY, LEARNED) else f"{ENTRY}/{policy}"
    recording = dc.replace(scenario.recording, content="light" if season.replays else "none")
    scenario = dc.replace(
        scenario,
        **autonomy,
        track=TRACK,
        drone=config.drone,
        laps=season.laps,
        seed=leg.seed,
        systems=dict(config.systems),
        recording=recording,
        map="",
    )
    scenario.simulator_config.target_realtime_rate = 0.0
    # The file of a policy is there only where the race is flown.
    dc.replace(scenario, policy=NO_POLICY if policy != LEARNED else policy).check()
    return scenario


def entry_scenario(scenario: Scenario) -> Scenario:
    """Returns what an entry may see of the simulation's scenario: settings, and a data sheet."""
    own = ("trajectory", "estimator", "policy", "perception", "explorer", "planner")
    own += ("state_filter", "rotor_monitor", "controller", "systems")
    told = Scenario(**{name: getattr(scenario, name) for name in (*_PUBLIC, *own)})
    told.referee.rate = scenario.referee.rate  # a step of the link is due when it checks
    return dc.replace(told, track=TRACK)


def _dump(scenario: Scenario) -> str:
    return yaml_dump_typed(scenario, schema=Scenario, child_name="Defaults")
