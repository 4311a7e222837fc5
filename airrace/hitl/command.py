"""airrace hitl: either side of a race with hardware in the loop, started by hand."""

import contextlib
import dataclasses as dc
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Group, Parameter

from airrace.common.errors import UserError
from airrace.common.interrupts import sigterm_as_ctrl_c
from airrace.diagrams.race_command import RaceOptions, fly
from airrace.hitl.companion import READY
from airrace.scenario import INTERNAL, MSP
from airrace.scenario.options import ScenarioOptions, resolve_scenario

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from airrace.betaflight.guard import Guard
    from airrace.hitl.companion import Companion
    from airrace.hitl.companion.address import Address
    from airrace.hitl.link.udp_bus import UdpBus
    from airrace.scenario import Scenario

EPILOG = """\
examples, on two computers on one cable:
  airrace hitl autonomy --lcm_url 'udpm://239.255.76.67:7667?ttl=1'
  airrace hitl simulation --lcm_url 'udpm://239.255.76.67:7667?ttl=1'
  airrace doctor --link --lcm_url 'udpm://239.255.76.67:7667?ttl=1'

The autonomy is started first, and ends with the race: 0 after it, 3 if the
simulation falls silent, 4 if its navigator dies, 5 if a board disarms, 1 on
Ctrl-C, 2 on bad input.
Both sides need the same scenario. The simulation takes all options of airrace race.

AIRRACE_PATIENCE=10 multiplies all waits by 10, for a slow computer."""


_ARM = "ARM"  # what a person types
LINK = Group("Hardware in the loop", sort_key=3)
BOARD = Group("A real flight controller", sort_key=3)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class HitlOptions(RaceOptions):
    """What a race with hardware in the loop may be told."""

    companion: Annotated[
        str | None, Parameter(group=LINK, metavar="local|none|USER@HOST[:PORT]")
    ] = None
    (
        "where the autonomy runs in HITL: local = another process here; none = you start it "
        "yourself, see airrace hitl --help (default: local)"
    )
    identity: Annotated[Path | None, Parameter(group=LINK, metavar="FILE")] = None
    "the private key for --companion USER@HOST (default: those that ssh would try)"
    wheels: Annotated[Path | None, Parameter(group=LINK, metavar="DIR")] = None
    (
        "for a companion without the internet, a folder with a wheel of every locked package; "
        "the documentation of a companion board says how to fill it"
    )
    lcm_url: Annotated[str | None, Parameter(group=LINK, metavar="URL")] = None
    (
        "of LCM (default: udpm://239.255.76.67:7667?ttl=0, with a free port for --companion local, "
        "and ttl=1 for USER@HOST)"
    )
    link_key: Annotated[Path | None, Parameter(group=LINK, metavar="FILE")] = None
    (
        "sign what crosses the link, and drop what others send; a companion is brought the key "
        "(default: none). To make one: (umask 077; head -c 32 /dev/urandom > FILE)"
    )
    lockstep: Annotated[bool, Parameter(group=LINK, negative=())] = False
    "tick by tick in the place of real time; the same race as SITL"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class AutonomyOptions(ScenarioOptions):
    """What an autonomy may be told that flies a real board."""

    flight_controller: Annotated[str | None, Parameter(group=BOARD, metavar="msp:PLACE")] = None
    (
        "a flight controller with Betaflight that is told thrust and rates, too: msp: and its "
        "serial port, such as msp:/dev/ttyACM0"
    )
    betaflight_config: Annotated[str | None, Parameter(group=BOARD, metavar="FILE")] = None
    "what the board's command line prints after `dump`"
    allow_arming: Annotated[bool, Parameter(group=BOARD, negative=())] = False
    "let airrace arm the board, once a person has said so here; its motors turn then"


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    hitl = App(name="hitl", help="Run one side of a race whose autonomy is at the end of a cable.")
    hitl.help_epilogue = EPILOG
    hitl.command(autonomy)
    hitl.command(simulation)
    app.command(hitl)


def scenario_and_bus(
    options: ScenarioOptions, lcm_url: str | None, key: bytes | None
) -> tuple["Scenario", "UdpBus"]:
    """Returns the checked Scenario and the open link that options name; may raise UserError."""
    from airrace.hitl.link.endpoint import DEFAULT_URL
    from airrace.hitl.link.udp_bus import UdpBus

    return checked_scenario(options), UdpBus(lcm_url or DEFAULT_URL, key)


def checked_scenario(options: ScenarioOptions) -> "Scenario":
    """Returns the Scenario that options name, or raises UserError if it is none."""
    scenario = resolve_scenario(options)
    scenario.check()
    return scenario


def autonomy(
    *,
    options: AutonomyOptions = AutonomyOptions(),
    lcm_url: Annotated[str | None, Parameter(metavar="URL")] = None,
    link_key: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    output: Annotated[Path, Parameter(metavar="DIR")] = Path("autonomy"),
    resume: Annotated[Path | None, Parameter(metavar="DIR")] = None,
    patience: Annotated[float, Parameter(metavar="S")] = 180.0,
) -> int:
    """Run the autonomy, for a simulation at the other end.

    Args:
        lcm_url: of LCM; ttl=0 stays on this computer, ttl=1 leaves it
            (default: udpm://239.255.76.67:7667?ttl=0)
        link_key: the file of a key that the simulation has, too: sign what crosses the link, and
            drop what others send; (umask 077; head -c 32 /dev/urandom > FILE) makes one
        output: where its map and its checkpoint go (default: autonomy)
        resume: go on in a race that is on, with the checkpoint in the --output folder of the
            one that has ended; only of a folder that you trust, it can hold code
        patience: how long to wait for the simulation (default: 180 s)
    """
    from airrace.common.files import results_folder
    from airrace.common.interrupts import interrupt_flag
    from airrace.hitl.autonomy_process import AutonomyProcess
    from airrace.hitl.link.endpoint import DEFAULT_URL
    from airrace.hitl.link.link_key import key_of
    from airrace.hitl.lockstep_autonomy import LEFT, STOPPED

    ends = {LEFT: "the race is over", STOPPED: "interrupted"}
    key, url = key_of(link_key), lcm_url or DEFAULT_URL
    scenario, bus = scenario_and_bus(options, url, key)
    with contextlib.closing(bus), guarded_board(scenario, options.allow_arming) as board:
        with interrupt_flag() as interrupted, results_folder(output) as folder:
            process = AutonomyProcess(
                scenario,
                bus,
                folder,
                stop=lambda: interrupted.is_set,
                resume=resume,
                url=url,
                board=board,
            )
            with contextlib.closing(process):
                process.prepare(url, key)
                if options.allow_arming:
                    ask_to_arm()
                print(READY, flush=True)
                code = process.run(patience)
            if code in ends:
                print(f"airrace: {ends[code]}; see {folder}", flush=True)
            return code


@contextlib.contextmanager
def guarded_board(scenario: "Scenario", may_arm: bool) -> "Iterator[Guard | None]":
    """Yields what commands the board of a scenario, None if it has none; disarms it at the end.

    Args: may_arm: whether a race may arm it.

    Raises:
        UserError: if it cannot be had, or may not be armed.
    """
    place = scenario.flight_controller.removeprefix(MSP)
    if place == scenario.flight_controller:
        if may_arm or place != INTERNAL:
            raise UserError(
                "An autonomy at the end of a link commands a board, or none: add "
                "--flight_controller msp:PLACE, or leave --allow_arming out."
            )
        yield None
        return
    from airrace.betaflight.guard import Guard, Setup
    from airrace.betaflight.settings import lines_of

    dump = "\n".join(lines_of(Path(scenario.betaflight_config)))
    with contextlib.closing(Guard(Setup(place, dump, scenario.drone, may_arm))) as board:
        yield board


def ask_to_arm() -> None:
    """Warns of what motors do, and waits for a person's word.

    Raises:
        UserError: if there is no person, or the word is another.
    """
    print(
        "airrace: THE MOTORS OF THE BOARD TURN AS SOON AS THE RACE BEGINS. Take all propellers "
        "off, and keep the battery's plug in your hand.",
        flush=True,
    )
    if not sys.stdin.isatty():
        raise UserError("Arming is a person's act: start this in a terminal.")
    word = ""
    with contextlib.suppress(EOFError):  # Ctrl-D
        word = input(f"airrace: type {_ARM} to arm it: ").strip()
    if word != _ARM:
        raise UserError("The board is not armed.")


@sigterm_as_ctrl_c()
def simulation(*, options: HitlOptions = HitlOptions()) -> int:
    """Run the simulation, for an autonomy that waits at the other end."""
    from airrace.hitl.hitl_race import BY_HAND

    result, _ = fly_hitl(dc.replace(options, companion=BY_HAND))
    return 0 if result["finished"] else 1


def hitl_scenario(options: HitlOptions) -> "Scenario":
    """Returns the checked Scenario that options ask for, as both sides of the link get it.

    Raises:
        UserError: naming the option or the field and the remedy.
    """
    from airrace.hitl.hitl_race import prepared

    scenario = prepared(resolve_scenario(options), options.lockstep)
    scenario.check()
    if scenario.flight_controller != INTERNAL:
        raise UserError(
            "With hardware in the loop, the simulated drone's motors are driven by the autonomy: "
            "set flight_controller to internal, or fly Betaflight by `airrace race` without -s."
        )
    return scenario


def ssh_companions(options: HitlOptions) -> "Callable[[Address], Companion]":
    """Returns what makes the companion for an Address, as the options say.

    Raises:
        UserError: naming the option and the remedy.
    """
    from airrace.hitl.companion.address import parse_address

    companion = options.companion or "local"
    by_ssh = companion not in ("local", "none")
    if by_ssh:
        parse_address(companion)
    for option in ("identity", "wheels"):
        if getattr(options, option) is not None and not by_ssh:
            raise UserError(
                f"--{option} is for a companion that is reached by ssh: add -s HITL "
                "--companion USER@HOST, or leave it out."
            )
    if options.identity is not None and not options.identity.is_file():
        raise UserError(f"--identity {options.identity} is no file; name that of a private key.")
    if options.wheels is not None and not options.wheels.is_dir():
        raise UserError(
            f"--wheels {options.wheels} is no folder; fill one with pip download, as the "
            "documentation of a companion board says."
        )

    def make(address):
        from airrace.hitl.companion.ssh_companion import SshCompanion

        return SshCompanion(address, identity=options.identity, wheels=options.wheels)

    return make


def fly_hitl(options: HitlOptions, quiet: bool = False) -> tuple[dict, Path]:
    """Flies a race whose autonomy is at the other end of a link; see fly() of a race's command."""
    from airrace.hitl.hitl_race import remote_transport

    if options.companion is None:
        options = dc.replace(options, companion="local")
    scenario = hitl_scenario(options)
    make_companion = ssh_companions(options)

    def transport(scenario, output_dir, note):
        return remote_transport(options, scenario, output_dir, make_companion, note)

    return fly(options, quiet, scenario=scenario, transport=transport)
