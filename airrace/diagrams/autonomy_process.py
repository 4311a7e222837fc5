"""The autonomy's end of a race: its own Simulator, driven by what comes over the link."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.analysis import InitializeParams, Simulator

from airrace.common.patience import patient
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.hitl.channels import make_channels
from airrace.hitl.checkpoint import CHECKPOINT_PERIOD, restore, save
from airrace.hitl.lcm_bridge import PREDICTED, MakeAutonomySide, ports_wanted
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import AUTONOMY, Endpoint
from airrace.hitl.link.lockstep import Exchange, PeerLost, await_peer, lockstep_times
from airrace.hitl.link.probe import CHANNELS, Responder
from airrace.hitl.planning_worker import PlanningWorker
from airrace.hitl.remote_autonomy import LOCKSTEP
from airrace.hitl.transport import POLL_PERIOD
from airrace.scenario import VIO
from airrace.systems.planning.lap_planner import LapPlanner

if TYPE_CHECKING:
    import lcm

    from airrace.hitl.link.simulated_bus import SimulatedBus
    from airrace.scenario import Scenario

LEFT, STOPPED, LOST = 0, 1, 3  # exit codes
_PATIENCE = 5.0  # s without a heartbeat in a race
_NEWS = 5.0  # s from one line about compiling to the next
_TICK = 0.001  # s, that it waits for a message at most
_GAP = 0.1  # s, beyond which the past is not caught up with


class AutonomyProcess:
    """Runs the autonomy of a scenario until the simulation ends the race."""

    def __init__(
        self,
        scenario: "Scenario",
        bus: "lcm.LCM | SimulatedBus",
        output_dir: Path,
        log: Callable[[str], object] = print,
        stop: Callable[[], bool] = lambda: False,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Constructs it; it listens from now on.

        Args:
            scenario: the race.
            bus: from open_lcm().
            output_dir: where the checkpoint and the map go.
            log: takes lines.
            stop: asked now and then; whether to end.
            clock: of the Endpoint (s).

        Raises:
            UserError: if the variable of patient() is no number.
        """
        self._scenario, self._output_dir = scenario, output_dir
        self._log, self._stop = log, stop
        self._autonomy = MakeAutonomy(scenario)
        self.channels = make_channels(scenario, ports_wanted(self._autonomy))
        self._endpoint = Endpoint(AUTONOMY, [*self.channels, *CHANNELS], bus, clock)
        self._responder = Responder(self._endpoint)
        self._patience = patient(_PATIENCE)
        self._said = float("-inf")  # when the log was last told that it compiles, s
        self._delay = 0.0  # s, there and back, that is compensated for

    def run(self, resume: Path | None = None, patience: float = 60.0) -> int:
        """Waits for a simulation and races; returns the exit code.

        Laps are planned in a process of their own, while control goes on; in lockstep
        they are planned here, while everything else waits.

        Args:
            resume: folder with the checkpoint of an autonomy that has ended, to
                go on where it was; None: a new race.
            patience: how long to wait for the simulation (s).

        Raises:
            UserError: if there is none, or nothing to resume.
        """
        # The worker starts now, so that it is there when the first lap is to be planned.
        with contextlib.closing(PlanningWorker()) as worker:
            expected = phases.RACING if resume else phases.READY
            await_peer(
                self._endpoint, phases.WAITING, expected=expected, timeout=patience, poll=self._poll
            )
            mode, _, rate = self._endpoint.peer_heartbeat.value.text.partition(" ")
            self.build(lossless=mode == LOCKSTEP)
            if mode == LOCKSTEP:
                code = self._race_in_lockstep()
            else:
                self._endpoint.clock.rate = float(rate or 1.0)
                planner = self._autonomy.GetSubsystemByName("lap_planner")
                if isinstance(planner, LapPlanner):
                    planner.solve_elsewhere(worker.submit)
                code = self._race(resume)
        writer = self._simulator.get_system().GetSubsystemByName("gate_map_writer")
        writer.ForcedPublish(writer.GetMyContextFromRoot(self._context))
        return code

    def build(self, lossless: bool) -> None:
        """Makes the Simulator."""
        if self._scenario.estimator == VIO and not lossless:
            self._autonomy = MakeAutonomy(self._scenario, given=(PREDICTED,))
        diagram, self._receiver, self._sender, self._compensator = MakeAutonomySide(
            self._scenario,
            self._autonomy,
            self.channels,
            self._endpoint,
            lossless,
            self._output_dir,
        )
        self._simulator = Simulator(diagram)
        self._context = self._simulator.get_mutable_context()

    def show_compiling(self, count: int) -> None:
        """Tells the simulation, and now and then whoever reads the log, that it goes on.

        Args:
            count: of the functions that have been compiled.
        """
        self._endpoint.drain()
        self._endpoint.beat(phases.COMPILING, 0.0)
        now = self._endpoint.now()
        if now - self._said > _NEWS:
            self._said = now
            self._log(f"airrace: compiling, once; {count} functions are done")

    def _poll(self):
        self._responder.respond()
        if self._stop():
            raise KeyboardInterrupt

    def _race_in_lockstep(self) -> int:  # type: ignore[return]
        exchange = Exchange(self._endpoint, self._receiver, self._sender)
        try:
            exchange.receive(
                self._context, self._stop, poll=lambda: self._endpoint.beat(phases.READY, 0.0)
            )
            for now in lockstep_times(self._scenario, POLL_PERIOD):
                if now == 0.0:
                    self._simulator.Initialize()
                    exchange.send(self._context)
                    continue
                self._simulator.AdvanceTo(now)
                exchange.send(self._context)
                if exchange.receive(self._context, self._stop):
                    return STOPPED if self._stop() else LEFT
        except PeerLost as e:
            self._log(f"airrace: the simulation fell silent for {e.args[0]:.0f} s")
            return LOST

    def _race(self, resume: Path | None) -> int:
        while not self.is_ready():
            self._wait_and_poll(phases.WAITING)
            if self._endpoint.silence > self._patience:
                return self._lost()
        self.start(resume)
        while self._phase() == phases.READY and not self._ended():
            self._receiver.receive(self._context, self._endpoint)
            self._wait_and_poll(phases.READY)
        self._endpoint.clock.restart()
        saved = self._endpoint.now()
        while not self._ended():
            self._wait_and_poll(phases.RACING)
            self.step()
            if self._endpoint.now() - saved > CHECKPOINT_PERIOD:
                saved = self._endpoint.now()
                save(self._output_dir, self._autonomy, self._context)
        if self._stop():
            return STOPPED
        return LEFT if self._phase() == phases.OVER else self._lost()

    def is_ready(self) -> bool:
        """Whether something has come on every channel."""
        return self._receiver.is_complete(self._endpoint)

    def start(self, resume: Path | None = None) -> None:
        """Initializes the Simulator; see run()."""
        self._receiver.receive(self._context, self._endpoint)
        if resume:
            self._context.SetTime(self._sim_time())
            restore(resume, self._autonomy, self._context)
        self._initialize(fresh=not resume)

    def step(self) -> None:
        """Advances to what the simulation's clock shows, with what has come last, and sends."""
        self._receiver.receive(self._context, self._endpoint)
        clock = self._endpoint.clock
        delay = self._compensator.rounded(clock.rate * clock.usual_round_trip, self._delay)
        if delay != self._delay:
            self._delay = delay
            self._compensator.set_delay(
                self._compensator.GetMyMutableContextFromRoot(self._context), delay
            )
        now = self._sim_time()
        if now > self._context.get_time() + _GAP:
            self._context.SetTime(now)  # commands of the past are of no use
            self._initialize(fresh=False)
        elif now > self._context.get_time():
            self._simulator.AdvanceTo(now)
        self._sender.send(self._context)

    def _initialize(self, fresh: bool) -> None:
        """Initializes at the context's time; what is known stays unless it is a fresh start."""
        self._simulator.Initialize(InitializeParams(suppress_initialization_events=not fresh))

    def _sim_time(self):
        """Returns the simulated time at which a command of now will arrive (s)."""
        return self._endpoint.clock.sim_time(self._endpoint.now()) + self._delay

    def _phase(self) -> str:
        return self._endpoint.peer_heartbeat.value.phase

    def _ended(self) -> bool:
        if self._endpoint.silence > self._patience:
            self._endpoint.drain()  # a pause of this process is no silence of the simulation
        return (
            self._phase() == phases.OVER or self._stop() or self._endpoint.silence > self._patience
        )

    def _lost(self) -> int:
        self._log(f"airrace: the simulation fell silent for {self._patience:.0f} s")
        return LOST

    def poll_link(self, phase: str) -> None:
        """Takes in what has come, and shows that it is alive."""
        self._endpoint.drain()
        self._endpoint.beat(phase, self._context.get_time())

    def _wait_and_poll(self, phase):
        self._endpoint.wait(_TICK)
        self.poll_link(phase)
