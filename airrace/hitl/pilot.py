"""The pilot in real time: its own Simulator, driven by the link and by what the navigator says."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Diagram

from airrace.diagrams.autonomy import MakeNavigator, MakePilot
from airrace.hitl.channels import channel_name, make_channels
from airrace.hitl.checkpoint import CHECKPOINT_PERIOD, restore, states_of
from airrace.hitl.handover import Handover, Joined, PortValues, Ready, Resume, States
from airrace.hitl.lcm_bridge import PREDICTED, MakePilotSide, ports_wanted

if TYPE_CHECKING:
    from airrace.hitl.channels import PortChannel
    from airrace.hitl.link.endpoint import Endpoint
    from airrace.scenario import Scenario
    from airrace.systems.estimation.delay_compensator import DelayCompensator

_GAP = 0.1  # s, beyond which the past is not caught up with
_AGAIN = 0.05  # s, after which a navigator that is not ready yet is told everything again
_LOST = 1.0  # s without a word of the navigator's: then the drone is not led any more
_BLIND = 0.1  # s without a word of where the drone is: then a board is told nothing
_SENSED = channel_name("state_estimate"), channel_name("imu")  # channels that say so
_TOLERANCE = 0.1  # of a period, by which values may be handed over early


class Halves(NamedTuple):
    """The two diagrams of an autonomy in real time."""

    pilot: Diagram
    navigator: Diagram

    def channels(self, scenario: "Scenario") -> "tuple[PortChannel, ...]":
        """Returns the PortChannels of a race that they fly."""
        return make_channels(scenario, ports_wanted(*self))


def make_halves(scenario: "Scenario") -> Halves:
    """Builds both halves of the autonomy of a scenario, for a link that takes its time.

    Raises UserError if a system of the scenario cannot be had or does not fit.
    """
    given = (PREDICTED,) if scenario.localizes else ()
    return Halves(MakePilot(scenario, given), MakeNavigator(scenario))


class Pilot:
    """Flies by the newest messages, and by what the navigator last said."""

    def __init__(
        self, scenario: "Scenario", halves: Halves, endpoint: "Endpoint", handover: Handover
    ):
        """Constructs it.

        Args:
            halves: from make_halves(); it takes the pilot.
            endpoint: of the autonomy's side; from now on it receives what the pilot needs alone.
        """
        self._scenario, self._endpoint, self._handover = scenario, endpoint, handover
        self._side = MakePilotSide(scenario, *halves, halves.channels(scenario), endpoint)
        endpoint.only(self._side.receiver.channels)  # to decode pictures takes milliseconds
        self._compensator: DelayCompensator = self._side.compensator  # type: ignore[assignment]
        self._simulator = Simulator(self._side.diagram)
        self._context = self._simulator.get_mutable_context()
        self._outputs = {n: self._side.diagram.GetOutputPort(n) for n in self._side.sends}
        self._delay = 0.0  # s, there and back, that is compensated for
        self._period = (1.0 - _TOLERANCE) / scenario.state_estimate.rate
        self._sent = -1.0  # simulated time of what was handed over last (s)
        # When it was last told everything, heard, and given what to keep, by the endpoint's clock.
        self._asked = self._heard = self._kept = float("-inf")
        self._resume: Path | None = None
        self._race = endpoint.partners.me.race
        self._navigator_is_ready = False

    @property
    def time(self) -> float:
        """The simulated time to which it has come (s)."""
        return self._context.get_time()

    @property
    def is_led(self) -> bool:
        """Whether the navigator has said something of late."""
        patience = _LOST / min(self._endpoint.clock.rate, 1.0)
        return self._endpoint.now() - self._heard < patience

    @property
    def rate_command(self) -> np.ndarray | None:
        """Thrust and rates for a board, see set_rates(); None if they are not to be trusted.

        They are while the simulation, or what stands for it, tells where the drone is, and the
        navigator leads it.
        """
        endpoint, part = self._endpoint, self._side.part
        newest = [endpoint.newest(name) for name in _SENSED if name in self._side.receiver.channels]
        heard = max((each.arrival for each in newest if each is not None), default=float("-inf"))
        if not self.is_led or endpoint.now() - heard > _BLIND / min(endpoint.clock.rate, 1.0):
            return None
        return part.GetOutputPort("rate_command").Eval(part.GetMyContextFromRoot(self._context))

    def is_ready(self) -> bool:
        """Whether something has come on every channel, and the navigator is ready, too."""
        return self._navigator_is_ready and self._side.receiver.is_complete(self._endpoint)

    @property
    def waits_for(self) -> str:
        """What it is not ready without, in words."""
        missing = self._side.receiver.missing(self._endpoint)
        return f"nothing has come on {missing[0]}" if missing else "its navigator is not ready"

    def prepare(self, resume: Path | None = None) -> None:
        """Tells the navigator how it stands; to be called until is_ready().

        Args: resume: folder of a checkpoint to go on with, or None.

        Raises UserError if there is no such checkpoint.
        """
        self._hear()
        now = self._endpoint.now()
        if now - self._asked < _AGAIN or not self._side.receiver.is_complete(self._endpoint):
            return
        self._asked = now
        self._side.receiver.receive(self._context, self._endpoint)
        self._handover.send(Joined(self._race))
        if resume and self._resume is None:
            self._resume = resume
            restore(resume, self._side.part, self._context)
        if resume:
            self._context.SetTime(self._sim_time())
            self._handover.send(Resume(str(resume.absolute())))
        self._hand_over()

    def start(self) -> None:
        """Initializes the Simulator, at the time of the values that were handed over last."""
        self._side.receiver.receive(self._context, self._endpoint)
        if self._resume:
            self._context.SetTime(self._sim_time())
        self._initialize(fresh=not self._resume)

    def wait_for_start(self) -> None:
        """Takes in what comes, before the race has begun."""
        self._side.receiver.receive(self._context, self._endpoint)
        self._hear()

    def step(self) -> bool:
        """Advances to what the simulation's clock shows, with what has come last, and sends.

        Returns whether there was something to control.
        """
        side, context = self._side, self._context
        side.receiver.receive(context, self._endpoint)
        self._hear()
        clock, before = self._endpoint.clock, context.get_time()
        delay = self._compensator.rounded(clock.rate * clock.usual_round_trip, self._delay)
        if delay != self._delay:
            self._delay = delay
            self._compensator.set_delay(
                self._compensator.GetMyMutableContextFromRoot(context), delay
            )
        now = self._sim_time()
        if now > before + _GAP:
            context.SetTime(now)  # commands of the past are of no use
            self._initialize(fresh=False)
        elif now > before:
            self._simulator.AdvanceTo(now)
        if self.is_led:
            side.sender.send(context)
        if context.get_time() - self._sent >= self._period:
            self._hand_over()
            if self._endpoint.now() - self._kept >= CHECKPOINT_PERIOD:  # the navigator writes it
                self._kept = self._endpoint.now()
                self._handover.send(States(self._race, states_of(side.part, context)))
        rate = self._scenario.controller.rate
        return int(rate * context.get_time()) > int(rate * before)

    def _hear(self):
        for message in self._handover.receive():
            self._heard = self._endpoint.now()
            match message:
                case Ready():
                    self._navigator_is_ready = True
                case PortValues(by_port=by_port) if by_port:
                    self._side.received.show(self._context, message)

    def _hand_over(self):
        self._sent = self._context.get_time()
        values = {name: port.Eval(self._context) for name, port in self._outputs.items()}
        self._handover.send(PortValues(self._sent, values))

    def _initialize(self, fresh):
        """Initializes at the context's time; what is known stays unless it is a fresh start."""
        self._simulator.Initialize(InitializeParams(suppress_initialization_events=not fresh))

    def _sim_time(self):
        """Returns the simulated time at which a command of now will arrive (s)."""
        return self._endpoint.clock.sim_time(self._endpoint.now()) + self._delay
