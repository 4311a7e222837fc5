"""Would an entry be accepted, and does it fly? On one screen."""

from collections.abc import Callable

from airrace.evaluation.versions import versions
from airrace.league.display import words_of
from airrace.league.entry import ENTRY_FILE, Entry
from airrace.league.entry_race import LOG
from airrace.league.sandbox import SandboxConfig
from airrace.league.season import Season, make_legs
from airrace.league.worker import fly, make_flight

# A short race that everybody may know.
_SEASON = Season(name="check", levels=[1], tracks=1, track="hexagon", laps=1, replays=False)
_TAIL = 12  # lines of what an entry wrote


def show_entry(entry: Entry, why_unsafe: str | None, show: Callable[[str], object]) -> None:
    """Shows what an entry is, line by line.

    Args: why_unsafe: why this computer offers no sandbox, or None.
    """
    config, files = entry.config, entry.files
    size = sum(map(len, files.values())) / 1e6
    show(f"entry     {entry.name}, of team {config.team}: accepted")
    show(f"files     {len(files)}, {size:.1f} MB of 50 at most; hash {entry.digest}")
    show(f"drone     {config.drone}")
    replaced = [f"{name} by {path}" for name, path in config.systems.items()]
    show(f"systems   {', '.join(replaced) or f'all as shipped; see {ENTRY_FILE}'}")
    packages = [f"{name} {version}" for name, version in config.packages.items()]
    show(f"packages  {', '.join(packages) or 'none beside those of airrace'}")
    show(f"sandbox   {'there is one' if why_unsafe is None else f'none: {why_unsafe}'}")


def fly_check(entry: Entry, safe: bool) -> dict:
    """Flies one lap of the hexagon, in a sandbox if ``safe``; returns its row, see fly()."""
    (leg,) = make_legs(_SEASON, "a race that everybody may know")
    sandbox = SandboxConfig(safe=safe, replay=False, limits=_SEASON.limits)
    return fly(make_flight(_SEASON, leg, entry, sandbox, versions({})), "check")


def show_flight(row: dict, show: Callable[[str], object]) -> None:
    """Shows how the race went, and if it was not finished, what the entry wrote last."""
    conduct = row["conduct"]
    show(f"race      {words_of(row)}")
    if "steps" in conduct:
        show(
            f"time      {conduct['cpu_s']:.1f} s of processor time; the longest step "
            f"{conduct['longest_step_s']:.2f} s; {conduct['missed_deadlines']} of "
            f"{conduct['steps']} steps too long"
        )
    for attempt in conduct["attempts"]:
        show(f"refused   it {attempt}")
    said = row["files"][LOG].decode(errors="replace").strip()
    if said and not row["result"]["finished"]:
        show("What it wrote last:")
        for line in said.splitlines()[-_TAIL:]:
            show(f"  {line}")
