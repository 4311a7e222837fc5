"""Sets up the other end of a HITL race, and takes it down again."""

import contextlib
import dataclasses as dc
import importlib.util
import json
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from airrace.common.errors import UserError
from airrace.common.files import files_in, write_json
from airrace.common.json_files import read_json
from airrace.common.patience import patient
from airrace.common.processes import ending
from airrace.common.resources import find_yaml, models_path
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.autonomy_process import PILOT_LINK
from airrace.hitl.channels import make_channels
from airrace.hitl.companion import OUTPUT, Autonomy, Companion
from airrace.hitl.companion.address import Address, parse_address
from airrace.hitl.companion.local import LocalCompanion
from airrace.hitl.lcm_bridge import ports_wanted
from airrace.hitl.link import phases
from airrace.hitl.link.doctor import diagnose, refusal
from airrace.hitl.link.endpoint import DEFAULT_URL, SIMULATION, Endpoint
from airrace.hitl.link.link_key import key_of
from airrace.hitl.link.lockstep import await_peer
from airrace.hitl.link.partners import Partner
from airrace.hitl.link.probe import measure
from airrace.hitl.link.udp_bus import UdpBus
from airrace.hitl.navigator import NAVIGATOR_LINK
from airrace.hitl.remote_autonomy import LockstepRemote, RealTimeRemote, Remote
from airrace.hitl.shared_settings import shared_settings
from airrace.hitl.warm_up import warm_up
from airrace.scenario import LINK_DELAY, Scenario, scenario_yaml
from airrace.vehicle import DRONES, find_vehicle

BY_HAND = "none"  # --companion, if the user starts the autonomy
_TEST = 1.0  # s, of the link before a race
# s that an autonomy may take to start: by the user, and by the race, which notices its end. The
# first time it compiles, which takes minutes on a board.
_START_BY_HAND, _START = 180.0, 600.0
_KEY = "link.key"  # what the autonomy calls the file of --link_key
_FAREWELL = 15.0  # s, that the autonomy has to end by itself


def default_url(companion: str) -> str:
    """Returns the LCM URL for --companion: only another computer gets beyond this one.

    An autonomy on this computer gets a UDP port that is free, so that races beside one
    another do not disturb each other.
    """
    if companion == "local":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.bind(("", 0))
            return DEFAULT_URL.replace("7667", str(s.getsockname()[1]))
    return DEFAULT_URL if companion == BY_HAND else DEFAULT_URL.replace("ttl=0", "ttl=1")


def prepared(scenario: Scenario, lockstep: bool) -> Scenario:
    """Returns the scenario as both sides of a HITL race get it.

    In real time, its rate is 1 unless another is given.

    Raises UserError if it is not to explore: the link is about pictures and maps.
    """
    if scenario.map:
        raise UserError("--map is for SITL: leave out -s HITL, or have the autonomy explore.")
    config = scenario.simulator_config
    config.target_realtime_rate = 0.0 if lockstep else config.target_realtime_rate or 1.0
    if not lockstep and scenario.link_delay == 0.0:
        scenario.link_delay = LINK_DELAY
    return scenario


@contextlib.contextmanager
def remote_transport(
    args: Any,
    scenario: Scenario,
    output_dir: Path,
    make_companion: Callable[[Address], Companion],
    note: Callable[[str], object] = print,
) -> Iterator[Remote]:
    """Starts the autonomy, checks the link, and yields the Remote to race with.

    Args:
        args: has companion, lcm_url, link_key and lockstep, as the command line's options.
        output_dir: what the autonomy has written is left in ``autonomy`` there.
        make_companion: from the Address of another computer to a Companion.

    Raises UserError if the autonomy cannot be started, or the link cannot carry a race.
    """
    companion, lockstep = args.companion, args.lockstep
    url = args.lcm_url or default_url(companion)
    # What waits for the time is the link, not Drake's Simulator.
    config = scenario.simulator_config
    rate, config.target_realtime_rate = config.target_realtime_rate, 0.0
    key = key_of(args.link_key)
    bus = UdpBus(url, key)
    channels = make_channels(scenario, ports_wanted(MakeAutonomy(scenario)))
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.closing(bus))
        poll = poll_start = lambda: None
        patience = _START_BY_HAND if companion == BY_HAND else _START
        if companion != BY_HAND:
            address = parse_address(companion)
            there = LocalCompanion() if address is None else make_companion(address)
            stack.enter_context(contextlib.closing(there))
            folder = output_dir / "autonomy"
            poll, poll_start = _start(there, scenario, url, key, folder, note, stack)
        else:
            note(
                f"Waiting for an autonomy, at most {patience:.0f} s after the last sign of one: "
                f"airrace hitl autonomy --lcm_url '{url}'"
            )
        me = Partner(secrets.token_hex(16), shared_settings(scenario, channels), url=url)
        if not lockstep:
            warm_up(scenario)
            findings = measure(bus, scenario, _TEST, poll=poll_start, patience=patience, me=me)
            if reason := refusal(diagnose(findings)):
                raise UserError(reason)
        endpoint = Endpoint(SIMULATION, channels, bus, me=me)
        stack.callback(endpoint.close)
        await_peer(endpoint, phases.WAITING, timeout=patience, poll=poll_start)
        if lockstep:
            yield LockstepRemote(channels, endpoint, poll)
        else:
            yield RealTimeRemote(channels, endpoint, poll, rate)


def _start(companion, scenario, url, key, folder, note, stack):
    """Starts the autonomy, which is ended and whose files are fetched when the stack unwinds.

    Returns its poll(), which notes how it ended, and one that raises UserError if it has.
    """
    last, noted = "", False

    def log(line):
        nonlocal last
        last = line
        note(f"autonomy: {line}")

    arguments = ["--lcm_url", url, "--output", OUTPUT, "--scenario_file", "scenario.yaml"]
    files = files_of(scenario)
    if key is not None:
        files[_KEY], arguments = key, [*arguments, "--link_key", _KEY]
    autonomy = companion.start(arguments, files, log)
    stack.callback(_collect, autonomy, folder, note)

    def poll():
        nonlocal noted
        code = autonomy.poll()
        if code is not None and not noted:
            noted = True
            note(f"autonomy: its process {ending(code)}")
        return code

    def poll_start():
        if (code := autonomy.poll()) is not None:
            said = f": {last.removeprefix('airrace: ')}" if code > 0 and last else "."
            raise UserError(f"The autonomy's process {ending(code)} before the race{said}")

    return poll, poll_start


def _collect(autonomy: Autonomy, folder: Path, note: Callable[[str], object]) -> None:
    """Waits for the autonomy's end, or ends it after a while, and brings what it has written."""
    end = time.monotonic() + patient(_FAREWELL)
    while autonomy.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    autonomy.stop()
    try:
        autonomy.collect(folder)
        _add_counts(folder)
    except UserError as e:  # the race's own files are there
        note(f"airrace: {e}")
    with contextlib.suppress(OSError):
        folder.rmdir()  # if it had written nothing


def _add_counts(folder: Path) -> None:
    """Adds to race.json what pilot and navigator have counted on the link."""
    path = folder.parent / "race.json"
    if not path.exists():
        return  # there was no race
    result = json.loads(path.read_text())
    link = result["wall"].setdefault("link", {})
    for half, name in (("pilot", PILOT_LINK), ("navigator", NAVIGATOR_LINK)):
        if (folder / name).exists():
            remedy = "race.json is without it"
            link[half] = read_json(folder / name, dict[str, object], "count of messages", remedy)
    write_json(path, result)


def files_of(scenario: Scenario) -> dict[str, bytes]:
    """Returns all files that the autonomy needs, by their paths in its working directory.

    That is the scenario, and the track, the drone and the modules that it names
    unless airrace brings them.

    Raises UserError if one cannot be had.
    """
    files = {}
    track = find_yaml("tracks", scenario.track)
    if track.parent != models_path() / "tracks":
        files["track.yaml"] = track.read_bytes()
        scenario = dc.replace(scenario, track="track.yaml")
    if scenario.drone not in DRONES:
        folder = find_vehicle(scenario.drone).parent
        for path in files_in(folder):
            files[f"drone/{path.relative_to(folder).as_posix()}"] = path.read_bytes()
        scenario = dc.replace(scenario, drone="./drone")
    for system in scenario.systems.values():
        files |= _module_files(system.partition(":")[0].partition(".")[0])
    files["scenario.yaml"] = scenario_yaml(scenario, absolute=False).encode()
    return files


def _module_files(name: str) -> dict[str, bytes]:
    """Returns the files of a top-level module or package outside of any site-packages."""
    found = importlib.util.find_spec(name)
    if name == "airrace" or not (found and found.origin) or "site-packages" in found.origin:
        return {}
    origin = Path(found.origin)
    module = origin.parent if origin.name == "__init__.py" else origin
    return {
        path.relative_to(module.parent).as_posix(): path.read_bytes() for path in files_in(module)
    }
