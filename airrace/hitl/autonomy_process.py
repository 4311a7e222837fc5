"""The autonomy's end of a race: in lockstep as one, in real time as a pilot and a navigator."""

import contextlib
import gc
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from airrace.common.errors import UserError, words
from airrace.common.files import write_json
from airrace.common.patience import patient
from airrace.common.processes import ending, real_time_priority
from airrace.common.tick_times import LoopTimes
from airrace.common.words import count as words_count
from airrace.diagrams.autonomy import MakeAutonomy
from airrace.diagrams.own_systems import find_mistake
from airrace.hitl.budget import Budget, prepare_halves
from airrace.hitl.checkpoint import race_of
from airrace.hitl.handover import Ended
from airrace.hitl.lcm_bridge import MakeLockstepSide
from airrace.hitl.link import phases
from airrace.hitl.link.endpoint import AUTONOMY, Endpoint
from airrace.hitl.link.lockstep import await_peer
from airrace.hitl.link.partners import Partner
from airrace.hitl.link.probe import CHANNELS, Responder
from airrace.hitl.lockstep_autonomy import LEFT, LOST, NOTHING_HEARD, STOPPED, race_in_lockstep
from airrace.hitl.navigator_process import NavigatorProcess
from airrace.hitl.pilot import Pilot, make_halves
from airrace.hitl.remote_autonomy import LOCKSTEP
from airrace.hitl.shared_settings import shared_settings

if TYPE_CHECKING:
    from airrace.betaflight.guard import Guard
    from airrace.hitl.link.bus import Bus
    from airrace.scenario import Scenario

NAVIGATOR_ENDED, BOARD_ENDED = 4, 5  # exit codes; the others are lockstep_autonomy's
PILOT_TICKS, PILOT_LINK = "pilot_ticks.json", "pilot_link.json"
_PATIENCE = 5.0  # s without a heartbeat in a race
_NEWS = 5.0  # s from one line about compiling to the next
_TICK = 0.001  # s, that it waits for a message at most
_TIDY = 1.0  # s from one look for garbage to the next
_TOLD = "it was told to stop"
_TRIAL, _BRIEFEST = 1.5, 0.1  # s of made-up messages, by which it says whether it is fast enough


class AutonomyProcess:
    """Runs the autonomy of a scenario until the simulation ends the race.

    In real time it is the pilot, and starts the navigator as a second process.
    """

    def __init__(
        self,
        scenario: "Scenario",
        bus: "Bus",
        output_dir: Path,
        log: Callable[[str], object] = print,
        stop: Callable[[], bool] = lambda: False,
        clock: Callable[[], float] = time.monotonic,
        *,
        resume: Path | None = None,
        url: str = "",
        board: "Guard | None" = None,
    ):
        """Constructs it; it listens from now on.

        Args: bus: to the simulation. stop: asked now and then; whether to end. clock: of the
        Endpoint (s). resume: folder with the checkpoint of an autonomy that has ended, to go on
        with. url: of the bus. board: a real one, which is commanded, too.

        Raises UserError if there is no such checkpoint, or the variable of patient() is no number.
        """
        self._scenario, self._output_dir = scenario, output_dir
        self._log, self._stop = log, stop
        self._halves = make_halves(scenario)
        self.channels = self._halves.channels(scenario)
        me = Partner(shared=shared_settings(scenario, self.channels), url=url)
        if resume is not None:
            me.race, me.resumes = race_of(resume), True
        self._resume, self._board = resume, board
        self._endpoint = Endpoint(AUTONOMY, [*self.channels, *CHANNELS], bus, clock, me=me)
        self._responder = Responder(self._endpoint)
        self._navigator: NavigatorProcess | None = None
        self._budget: Budget | None = None
        self._patience = patient(_PATIENCE)
        self._said = float("-inf")  # when the log was last told that it compiles, s

    def prepare(self, lcm_url: str, key: bytes | None = None) -> None:
        """Starts the navigator; pilot and navigator compile what they run, each its own.

        Args: lcm_url, key: see UdpBus.

        Raises UserError if the navigator cannot begin.
        """
        briefly = self._resume is not None  # see warm_up_pilot()
        scenario, duration = self._scenario, _BRIEFEST if briefly else _TRIAL
        session, poll = self._endpoint.session, self._poll
        self._navigator = NavigatorProcess(
            scenario,
            lcm_url,
            self._output_dir,
            key=key,
            session=session,
            briefly=briefly,
            duration=duration,
        )
        self._budget = prepare_halves(
            scenario, self._navigator, duration, briefly, self.show_compiling, poll
        )

    def close(self) -> None:
        """Ends the navigator, if there is one."""
        if self._navigator is not None:
            self._navigator.close()

    def run(self, patience: float = 60.0) -> int:
        """Waits for a simulation, at most some time (s), and races; returns the exit code.

        Raises UserError if there is none, or it does not fit.
        """
        try:
            return self._run(patience)
        except Exception as e:
            mistake = find_mistake(e, self._scenario)
            what = mistake.sentence if mistake else words(e)
            self._say_last(f"it was stopped by an error: {what}")
            raise

    def _run(self, patience: float) -> int:
        expected = phases.RACING if self._resume else phases.READY
        await_peer(
            self._endpoint, phases.WAITING, expected=expected, timeout=patience, poll=self._poll
        )
        met = self._endpoint.peer_heartbeat.value
        self._endpoint.join(met.race)
        if met.mode == LOCKSTEP:
            self.close()
            if self._board is not None:
                raise UserError("A board is commanded in real time: race without --lockstep.")
            autonomy = MakeAutonomy(self._scenario)
            side = MakeLockstepSide(
                self._scenario, autonomy, self.channels, self._endpoint, self._output_dir
            )
            code = race_in_lockstep(self._scenario, side, self._endpoint, self._log, self._stop)
            self._save_counts()
            if code == STOPPED:
                self._say_last(_TOLD)
            return code
        assert self._navigator is not None and self._budget is not None  # of prepare()
        self._endpoint.clock.rate = met.rate if 0.0 < met.rate < math.inf else 1.0
        self._log(f"airrace: {self._budget.verdict(self._endpoint.clock.rate)}")
        return self._race(self._navigator)

    def show_compiling(self, count: int) -> None:
        """Tells the simulation, and now and then whoever reads the log, how many are compiled."""
        self._endpoint.drain()
        self._endpoint.beat(phases.COMPILING, 0.0)
        now = self._endpoint.now()
        if now - self._said > _NEWS:
            self._said = now
            self._log(f"airrace: compiling, once; {words_count(count, 'function')} done")

    def _save_counts(self):
        """Writes counts of what came over the link."""
        write_json(self._output_dir / PILOT_LINK, self._endpoint.summary())

    def _poll(self):
        self._endpoint.drain()
        self._responder.respond()
        if self._stop():
            raise KeyboardInterrupt

    def _race(self, navigator: NavigatorProcess) -> int:
        pilot = Pilot(self._scenario, self._halves, self._endpoint, navigator.handover)
        while not pilot.is_ready():
            self._wait_and_poll(phases.WAITING, pilot.waits_for)
            pilot.prepare(self._resume)
            if self._has_lost(navigator):
                return NAVIGATOR_ENDED
            if self._endpoint.silence > self._patience:
                return self._lost()
        pilot.start()
        if self._board is not None:
            self._board.arm()
        while self._phase() == phases.READY and not self._ended():
            pilot.wait_for_start()
            self._wait_and_poll(phases.READY)
            if self._has_lost_board():
                return BOARD_ENDED
        self._endpoint.clock.restart()
        with _without_garbage_collection(), real_time_priority():
            code = self._fly(pilot, navigator)
        return code

    def _fly(self, pilot: Pilot, navigator: NavigatorProcess) -> int:
        """Flies the race; returns the exit code."""
        ticks, tidied = LoopTimes(), self._endpoint.now()
        while not self._ended():
            if self._has_lost(navigator):
                return NAVIGATOR_ENDED
            if self._has_lost_board():
                return BOARD_ENDED
            self._endpoint.wait(_TICK)
            ticks.start()
            self._endpoint.drain()
            self._endpoint.beat(phases.RACING, pilot.time)
            has_controlled = pilot.step()
            if self._board is not None and has_controlled:
                self._board.command(pilot.rate_command)
            if self._endpoint.now() - tidied > _TIDY:
                tidied = self._endpoint.now()
                gc.collect(0)  # a tenth of a millisecond: all that is old is frozen
            if has_controlled:
                ticks.stop()
        ticks.save(self._output_dir / PILOT_TICKS)
        self._save_counts()
        if self._stop():
            self._say_last(_TOLD)
            return STOPPED
        return LEFT if self._phase() == phases.OVER else self._lost()

    def _has_lost(self, navigator: NavigatorProcess) -> bool:
        """Whether the navigator has ended; then it says so, also to the simulation.

        The drone is left to its flight controller, as if the link had failed: without a map it
        does not know where to fly.
        """
        if (code := navigator.poll()) is None:
            return False
        reason = f"its navigator {ending(code)}"
        for message in navigator.handover.receive():
            if isinstance(message, Ended):
                reason = message.reason
        self._log(f"airrace: the autonomy gives up: {reason}")
        self._say_last(reason)
        return True

    def _has_lost_board(self) -> bool:
        """Whether a board, if there is one, is not commanded any more; then it says so."""
        if self._board is None or (reason := self._board.poll()) is None:
            return False
        self._log(f"airrace: the board is disarmed: {reason}")
        self._say_last(reason)
        return True

    def _say_last(self, reason: str) -> None:
        """Tells the simulation why nothing more will come."""
        sim_time = self._endpoint.peer_heartbeat.stamp.time
        self._endpoint.say_last(self._endpoint.partners.phase, sim_time, reason)

    def _phase(self) -> str:
        return self._endpoint.peer_heartbeat.value.phase

    def _ended(self) -> bool:
        if self._endpoint.silence > self._patience:
            self._endpoint.drain()  # a pause of this process is no silence of the simulation
        is_silent = self._endpoint.silence > self._patience
        return is_silent or self._phase() == phases.OVER or self._stop()

    def _lost(self) -> int:
        self._log(f"airrace: the simulation fell silent for {self._patience:.0f} s")
        self._say_last(NOTHING_HEARD.format(self._patience))  # to one that only stood still
        return LOST

    def _wait_and_poll(self, phase, text=""):
        """Waits a moment, takes in what has come, and shows that it is alive."""
        self._endpoint.wait(_TICK)
        self._endpoint.drain()
        self._endpoint.beat(phase, 0.0, text)


@contextlib.contextmanager
def _without_garbage_collection():
    """Lets Python look for garbage only when it is asked to: it takes up to 100 ms at a time."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
