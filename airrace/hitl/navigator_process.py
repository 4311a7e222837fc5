"""The navigator as a process beside the pilot's, at a lower priority: control comes first."""

import contextlib
import gc
import os
import select
import signal
import socket
import subprocess
import sys
from pathlib import Path

from airrace.common import jit
from airrace.common.errors import UserError
from airrace.common.patience import patient
from airrace.common.processes import bound_to
from airrace.common.resources import load_yaml
from airrace.common.tick_times import LoopTimes
from airrace.hitl.handover import Compiling, Ended, Message, Playing, Setup, SocketHandover, Warm
from airrace.hitl.link.message_socket import start_module
from airrace.scenario import Scenario, scenario_yaml

NAVIGATOR_TICKS = "navigator_ticks.json"
_NICE = 5  # the planner's is greater still
_IDLE = 0.5  # s, after which it looks whether the pilot is still there
_FAREWELL = 10.0  # s, that it has to write the map


class NavigatorProcess:
    """The navigator, as the pilot's process has it.

    Attributes:
        handover: to it.
    """

    def __init__(
        self,
        scenario: Scenario,
        lcm_url: str,
        output_dir: Path,
        *,
        key: bytes | None = None,
        session: int = 0,
        briefly: bool = False,
        duration: float,
    ):
        """Starts it. Args: scenario: the race. The others: see Setup."""
        setup = Setup(
            scenario_yaml(scenario),
            lcm_url,
            key,
            str(output_dir.absolute()),
            session,
            briefly,
            duration,
        )
        self._process, here = start_module(__name__)
        self.handover = SocketHandover(here)
        self.handover.send(setup)

    def receive(self, timeout: float = 0.01) -> list[Message]:
        """Returns what it has said, after a while at most (s)."""
        if not self.handover.link.is_broken:
            self.handover.link.wait(timeout)
        return self.handover.receive()

    def poll(self) -> int | None:
        """Returns its exit code, None while it runs."""
        return self._process.poll()

    def close(self) -> None:
        """Ends it; it writes the map before."""
        self.handover.link.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(patient(_FAREWELL))
        self._process.kill()
        self._process.wait()


def navigate(setup: Setup, handover: SocketHandover) -> None:
    """Warms up, and navigates until the other end of the handover is closed."""
    # Imported at a low priority: this takes seconds of a processor.
    from airrace.hitl.link.udp_bus import UdpBus
    from airrace.hitl.navigator import Navigator
    from airrace.hitl.pilot import make_halves
    from airrace.hitl.planning_worker import PlanningWorker
    from airrace.hitl.warm_up import play_navigator, warm_up_navigator

    scenario = load_yaml(Scenario, data=setup.scenario, child_name="Defaults")
    # The worker starts now, so that it is there when the first lap is to be planned.
    with contextlib.closing(PlanningWorker(scenario)) as worker:
        with jit.watched(lambda count: handover.send(Compiling(count))):
            with bound_to(os.getppid()):  # it has just sent the setup
                warm_up_navigator(scenario, setup.briefly)
        handover.send(Playing())
        share = play_navigator(scenario, setup.duration).sum() / setup.duration
        bus, output_dir = UdpBus(setup.lcm_url, setup.key), Path(setup.output_dir)
        navigator = Navigator(
            scenario,
            make_halves(scenario),
            bus,
            handover,
            output_dir=output_dir,
            session=setup.session,
        )
        navigator.plan_elsewhere(worker.submit)
        handover.send(Warm(float(share)))
        gc.freeze()
        ticks = LoopTimes()
        while not handover.link.is_broken:
            select.select([handover.link, bus], [], [], _IDLE)  # type: ignore[type-var]
            ticks.start()
            if navigator.step():
                ticks.stop()
        navigator.end()
        ticks.save(output_dir / NAVIGATOR_TICKS)


def main(fileno: int) -> int:
    """Navigates for the process at the other end of a socket; returns the exit code."""
    os.nice(_NICE)
    for signum in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signum, signal.SIG_IGN)  # it ends with the pilot
    handover = SocketHandover(socket.socket(fileno=fileno))
    while not (messages := handover.receive()) and not handover.link.is_broken:
        handover.link.wait(_IDLE)
    if messages:
        try:
            navigate(messages[0], handover)  # type: ignore[arg-type]
        except UserError as e:
            handover.send(Ended(str(e)))
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
