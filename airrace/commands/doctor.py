"""airrace doctor: what this computer, or the link to an autonomy, lacks for a race."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from airrace.scenario.options import ScenarioOptions

if TYPE_CHECKING:
    from airrace.hitl.link.udp_bus import UdpBus
    from airrace.scenario import Scenario

EPILOG = """\
examples:
  airrace doctor                 this computer
  airrace doctor --board         and whether it flies the autonomy in real time
  airrace doctor --link          and the link, with an autonomy waiting at the other end
  airrace doctor --link --lcm_url 'udpm://239.255.76.67:7667?ttl=1'

Exit codes: 0 a race can start, 1 it cannot, 2 bad input."""


def add_to(app: App) -> None:
    """Adds the subcommand to the command line."""
    app.command(doctor, help_epilogue=EPILOG)


def doctor(
    *,
    board: Annotated[bool, Parameter(negative=())] = False,
    link: Annotated[bool, Parameter(negative=())] = False,
    lcm_url: Annotated[str | None, Parameter(metavar="URL")] = None,
    link_key: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    duration: Annotated[float, Parameter(metavar="S")] = 10.0,
    patience: Annotated[float, Parameter(metavar="S")] = 60.0,
    options: ScenarioOptions = ScenarioOptions(),
) -> int:
    """Say what keeps a race from running well here, and what to do about it.

    Args:
        board: fly the autonomy by made-up messages, to say whether this computer is fast enough
            for it in real time, or which --realtime_rate is slow enough
        link: measure the link to an autonomy that waits at the other end, too
        lcm_url: of LCM, with --link (default: udpm://239.255.76.67:7667?ttl=0)
        link_key: of the autonomy, with --link (default: none)
        duration: how long to measure the link, and to fly (default: 10 s)
        patience: how long to wait for the autonomy (default: 60 s)
    """
    from rich.console import Console

    from airrace.commands.computer_checks import check_computer
    from airrace.common.errors import UserError
    from airrace.hitl.command import checked_scenario, scenario_and_bus
    from airrace.hitl.link.doctor import BAD, make_table
    from airrace.hitl.link.link_key import key_of

    for name, value in (("lcm_url", lcm_url), ("link_key", link_key)):
        if value is not None and not link:
            raise UserError(f"--{name} is for the link: add --link.")
    ends = scenario_and_bus(options, lcm_url, key_of(link_key)) if link else None
    scenario = ends[0] if ends else checked_scenario(options)
    rows = check_computer()
    Console().print(make_table(rows, "This computer"))
    can_race = BAD not in [row.verdict for row in rows]
    if board and can_race:
        can_race = measure_board(scenario, duration)
    if ends is not None and can_race:
        can_race = measure_link(*ends, duration, patience)
    return 0 if can_race else 1


def measure_board(scenario: "Scenario", duration: float) -> bool:
    """Flies the autonomy for a while and prints how fast it is; returns whether fast enough.

    Args:
        scenario: of which races are to be flown.
        duration: of the flight (s).

    Raises:
        UserError: if the autonomy cannot be flown.
    """
    import contextlib
    import tempfile

    from rich.console import Console

    from airrace.hitl.budget import make_table, prepare_halves
    from airrace.hitl.link.endpoint import DEFAULT_URL
    from airrace.hitl.navigator_process import NavigatorProcess

    console = Console()
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.closing(
            NavigatorProcess(scenario, DEFAULT_URL, Path(folder), duration=duration)
        ) as navigator,
        console.status("flying the autonomy; the first time, it compiles"),
    ):
        budget = prepare_halves(scenario, navigator, duration)
    console.print(make_table(budget))
    verdict = budget.verdict()
    console.print(f"{verdict[0].upper()}{verdict[1:]}.", markup=False, highlight=False)
    return budget.spare() > 0.0


def measure_link(scenario: "Scenario", bus: "UdpBus", duration: float, patience: float) -> bool:
    """Measures the link and prints what it finds; returns whether a race can start.

    Args:
        scenario: which says what a race would send.
        bus: to the autonomy.
        duration, patience: of the measurement, and to wait for the other side (s).

    Raises:
        UserError: if nobody is at the other end.
    """
    from rich.console import Console
    from rich.progress import Progress

    from airrace.hitl.link.doctor import diagnose, make_table, refusal
    from airrace.hitl.link.probe import measure

    console = Console()
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("measuring the link", total=1.0)
        findings = measure(
            bus,
            scenario,
            duration,
            show=lambda share: progress.update(task, completed=share),
            patience=patience,
        )
    rows = diagnose(findings)
    console.print(make_table(rows))
    reason = refusal(rows)
    console.print(reason or "A race can start.", markup=False, highlight=False)
    return not reason
