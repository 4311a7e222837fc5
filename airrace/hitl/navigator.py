"""The navigator in real time: its own Simulator, driven by pictures and by what the pilot says."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.systems.analysis import InitializeParams, Simulator

from airrace.common.files import write_json
from airrace.hitl.checkpoint import restore, save, states_of
from airrace.hitl.handover import Handover, Joined, PortValues, Ready, Resume, States
from airrace.hitl.lcm_bridge import MakeNavigatorSide
from airrace.hitl.link.endpoint import AUTONOMY, Endpoint
from airrace.systems.planning.lap_planner import LapPlanner

if TYPE_CHECKING:
    from airrace.hitl.link.bus import Bus
    from airrace.hitl.pilot import Halves
    from airrace.scenario import Scenario

NAVIGATOR_LINK = "navigator_link.json"
_GAP = 0.5  # s, beyond which the past is not caught up with


class Navigator:
    """Sees, maps, explores and plans, as far as the pilot's time has come.

    Its time is that of the pilot's messages. They wait while it works on a picture, and it goes
    through all of them afterwards: so it knows where the drone was at each picture.
    """

    def __init__(
        self,
        scenario: "Scenario",
        halves: "Halves",
        bus: "Bus",
        handover: Handover,
        *,
        output_dir: Path,
        session: int,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Constructs it; it listens from now on.

        Args: halves: from make_halves(); it takes the navigator. session: of the pilot's Endpoint:
        both are the same autonomy to the simulation. clock: of the pilot's Endpoint (s).
        """
        channels = halves.channels(scenario)
        self._endpoint = Endpoint(AUTONOMY, channels, bus, clock, session=session)
        self._side = MakeNavigatorSide(scenario, *halves, channels, self._endpoint, output_dir)
        self._endpoint.only(self._side.receiver.channels)
        self._handover, self._output_dir = handover, output_dir
        self._simulator = Simulator(self._side.diagram)
        self._context = self._simulator.get_mutable_context()
        self._outputs = {n: self._side.diagram.GetOutputPort(n) for n in self._side.sends}
        self._received: dict = {}  # what was handed over last
        self._resume = ""  # the folder of a checkpoint to go on with
        self.is_started = False

    def plan_elsewhere(self, submit: Callable) -> None:
        """From now on laps are planned by submit(), see LapPlanner.solve_elsewhere()."""
        planner = self._side.part.GetSubsystemByName("lap_planner")
        if isinstance(planner, LapPlanner):
            planner.solve_elsewhere(submit)

    def step(self) -> bool:
        """Goes on with all that has come, and answers; returns whether there was anything.

        Raises UserError if there is no such checkpoint as the one to go on with.
        """
        self._endpoint.drain()  # first: no picture is newer than the last message of the pilot's
        messages = self._handover.receive()
        for message in messages:
            if message is messages[-1]:
                self._side.receiver.receive(self._context, self._endpoint)
            self._take(message)
        return bool(messages)

    def _take(self, message):
        match message:
            case Resume(folder):
                self._resume = folder
            case Joined(race):
                self._endpoint.join(race)
            case States(race, by_system) if self.is_started:
                states = states_of(self._side.part, self._context)
                save(self._output_dir, race, {**by_system, **states})
            case PortValues():
                self._go_on(message)

    def _go_on(self, message):
        """Advances to the time of the pilot's values, and answers."""
        side, context = self._side, self._context
        side.received.show(context, message)
        if not self.is_started:
            if side.receiver.is_complete(self._endpoint):
                self._start(message.time)
            return
        if message.time > context.get_time() + _GAP:
            context.SetTime(message.time)
            self._initialize(fresh=False)
        elif message.time > context.get_time():
            self._simulator.AdvanceTo(message.time)
        side.sender.send(context)
        self._answer()

    def _start(self, now):
        self._side.receiver.receive(self._context, self._endpoint)
        self._context.SetTime(now)
        if self._resume:
            restore(Path(self._resume), self._side.part, self._context)
        self._initialize(fresh=not self._resume)
        self.is_started = True
        self._answer()
        self._handover.send(Ready())

    def _answer(self):
        """Hands over what has changed."""
        now = {name: port.Eval(self._context) for name, port in self._outputs.items()}
        new = {name: v for name, v in now.items() if v is not self._received.get(name)}
        if self._handover.send(PortValues(self._context.get_time(), new)):
            self._received = now

    def end(self) -> None:
        """Writes the map as it is at the end, and counts of what came over the link."""
        write_json(self._output_dir / NAVIGATOR_LINK, self._endpoint.summary())
        writer = self._side.diagram.GetSubsystemByName("gate_map_writer")
        writer.ForcedPublish(writer.GetMyContextFromRoot(self._context))

    def _initialize(self, fresh):
        """Initializes at the context's time; what is known stays unless it is a fresh start."""
        self._simulator.Initialize(InitializeParams(suppress_initialization_events=not fresh))
