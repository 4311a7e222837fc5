"""A race whose result a benchmark can count on."""

from pathlib import Path

from airrace.diagrams.race import INTERRUPTED, run_race
from airrace.scenario import Scenario


def fly_race(scenario: Scenario, folder: Path, **options) -> dict:
    """Returns what race.json holds of a race. Args: as those of run_race().

    Raises:
        KeyboardInterrupt: if somebody ended it, so that no table takes it for one that failed.
    """
    result = run_race(scenario, folder, **options)
    if result["dnf_reason"] == INTERRUPTED:
        raise KeyboardInterrupt
    return result
