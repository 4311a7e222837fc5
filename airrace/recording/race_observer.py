"""Watches the ports of a race, and tells sinks what happens."""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, PortDataType

from airrace.recording import race_events as events
from airrace.recording.json_topics import estimate_error
from airrace.recording.log_sink import LogSink
from airrace.recording.race_events import DRONE, RaceEvent, Sink
from airrace.scenario import VIO, Scenario
from airrace.systems.estimation.error_state import GYRO_BIAS
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.planning.lap_plan import NO_PLAN
from airrace.systems.sensing.contact_sensor import as_contacts
from airrace.systems.sensing.imu_samples import IMU_DEPTH, IMU_ROW
from airrace.systems.types import ExplorerEvent
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import as_plant_state, as_state

_NAME = "race_observer"
_PAGE_RATE, _PAGE_CHANGES, _PAGE_PICTURES = 30.0, 10.0, 5.0  # Hz, if there is no log
_MAP_PERIOD = 1.0  # s, between two maps in a log, unless a lap has ended
_SAMPLED = ("state_estimate", "filtered_estimate", "disturbance", "imu", "reference")
_SAMPLED += ("rotor_speeds", "rotor_speed_command")
_CAMERA = ("camera_view", "camera_image_time", "camera_info")
# What of the value of a port tells whether it is new, and what that is before there is anything to
# tell. Over a link, the same value comes again and again as another object.
_KEYS: dict[str, tuple[Callable[[Any], Any], Any]] = {
    "detections": (lambda detections: detections.time, -1.0),
    "truth.gate_shifts": (lambda shifts: shifts.tolist(), None),
    "truth.referee_status": (lambda status: (len(status.crossings), status.over), (0, False)),
    "gate_map": (lambda gate_map: gate_map, None),  # equal only to itself
    "lap_plan": (lambda plan: (plan.lap, plan.start_time), (NO_PLAN.lap, NO_PLAN.start_time)),
    "explorer_status": (
        lambda s: (s.state, s.since, len(s.events), s.reason, s.gates, s.closed_at, s.done),
        ("", 0.0, 0, "", (), None, False),
    ),
    "pilot_status": (lambda status: (status.flies, status.reason), (False, "")),
    "rotor_losses": (lambda losses: np.flatnonzero(np.isfinite(losses)).tolist(), []),
    "truth.contacts": (lambda contacts: contacts[:2].tolist(), [0.0, 0.0]),
    "slam_state": (lambda slam: slam.time, -1.0),
}
FOR_RESULT = _KEYS.keys() - {"detections", "slam_state"}
FOR_LOG = _KEYS.keys() - {"pilot_status", "rotor_losses", "truth.contacts"}


class Changes:
    """What has changed at some ports since they were looked at last."""

    def __init__(self, ports: Iterable[str], drone: str, map_period: float = 0.0):
        """Args: map_period: between two maps, unless a lap has ended (s)."""
        self._keys = {port: _KEYS[port][1] for port in ports}
        self._drone, self._map_period, self._map_time = drone, map_period, -np.inf

    def _new(self, port, value_of):
        """Yields the value of a port, and the key of the one before, if it is new."""
        value = value_of(port) if port in self._keys else None
        if value is not None:
            key, before = _KEYS[port][0](value), self._keys[port]
            if key != before:
                self._keys[port] = key
                yield value, before

    def detections(self, time: float, value_of: Callable[[str], Any]) -> Iterator[RaceEvent]:
        """Yields the detections of a new picture; see events()."""
        for detections, _ in self._new("detections", value_of):
            yield events.DetectionsSeen(time, detections, drone=self._drone)

    def events(self, time: float, value_of: Callable[[str], Any]) -> Iterator[RaceEvent]:
        """Yields what is new at a time (s); value_of: returns a port's value, None without one."""
        new, drone = functools.partial(self._new, value_of=value_of), self._drone
        yield from self.detections(time, value_of)
        for shifts, _ in new("truth.gate_shifts"):
            yield events.GatesMoved(time, shifts)
        referee = [*new("truth.referee_status")]
        crossings = [each for status, (n, _) in referee for each in status.crossings[n:]]
        lap_ended = any(crossing.gate == 1 for crossing in crossings)
        if lap_ended or time >= self._map_time + self._map_period:
            for gate_map, _ in new("gate_map"):
                self._map_time = time
                yield events.MapChanged(time, gate_map, drone=drone)
        for plan, _ in new("lap_plan"):
            yield events.PlanMade(time, plan, drone=drone)
        for status, before in new("explorer_status"):
            entered = _states_entered(status, *before[:3])
            yield events.ExplorerChanged(time, status, entered, drone=drone)
        for status, _ in new("pilot_status"):
            yield events.PilotChanged(time, status, drone=drone)
        for losses, before in new("rotor_losses"):
            for i in np.flatnonzero(np.isfinite(losses)):
                if i not in before:
                    yield events.RotorLost(time, int(i) + 1, float(losses[i]), drone=drone)
        for contacts, _ in new("truth.contacts"):
            count = as_contacts(contacts)
            numbers = int(count.gates), int(count.environment)
            yield events.ContactsCounted(time, *numbers, drone=drone)
        for slam, _ in new("slam_state"):
            covariance = slam.belief.covariance[:GYRO_BIAS, :GYRO_BIAS]
            covariance = covariance.astype(np.float32).astype(float)
            error = _estimate_error(value_of("truth.state"), value_of("filtered_estimate"))
            yield events.EstimateMade(time, error, covariance, slam, drone=drone)
        for crossing in crossings:
            yield events.GateCrossed(time, crossing, drone=drone)
        for status, (_, was_over) in referee:
            if status.over and not was_over:
                yield events.RaceOver(time, status, drone=drone)


def _states_entered(status, state, since, count):
    """Returns the ExplorerEvents since there was a number of them, or since a state was entered."""
    if not status.events and (status.state, status.since) != (state, since):
        # An explorer of one's own may keep no events.
        return (ExplorerEvent(status.since, status.state, status.reason),)
    return status.events[count:]


def _estimate_error(truth, filtered):
    """Returns the error of the filtered estimate, see estimate_error(); NaN if not known."""
    if truth is None or filtered is None:
        return np.full(9, np.nan)
    return estimate_error(as_plant_state(truth), as_state(filtered))


class RaceObserver(LeafSystem):
    """Tells sinks what crosses a race's ports; see race_events.py.

    .. pydrake_system::

        name: RaceObserver
        input_ports:
        - truth.state
        - truth.referee_status, truth.gate_shifts, truth.contacts
        - state_estimate, filtered_estimate, disturbance, imu, reference
        - rotor_speeds, rotor_speed_command, rotor_losses
        - camera_view, camera_image_time, camera_info, detections
        - slam_state, gate_map, lap_plan, explorer_status, pilot_status

    All are as the systems that they come from describe them; of all but the first, those that are
    not there are not told of. The log and the page are told by the clock. Who flies the race asks
    itself what has changed, with look(). Nothing in the race depends on the observer: it only
    publishes, and what it remembers is what was told.
    """

    def __init__(
        self,
        ports: Mapping[str, int | None],
        scenario: Scenario,
        log: LogSink | None = None,
        page: Sequence[Sink] = (),
        drone: str = DRONE,
    ):
        """Constructs the observer.

        Args:
            ports: names of the ports that there are, and their sizes; None: of abstract ones.
            scenario: the race, which says how often the log wants to know what.
            log: that is told by the clock; close() closes it.
            page: sinks that are told by the clock, too.
            drone: name of the drone.
        """
        LeafSystem.__init__(self)
        self._ports = {
            name: self.DeclareAbstractInputPort(name, Value[object]())
            if size is None
            else self.DeclareVectorInputPort(name, size)
            for name, size in ports.items()
        }
        self._log, self._drone = log, drone
        self._sinks = [*([] if log is None else [log.take]), *page]
        # Of what was told last. It is output, not state: see the class.
        self._for_log = Changes(FOR_LOG, drone, _MAP_PERIOD)
        self._for_result = Changes(FOR_RESULT, drone)
        self._state_time, self._imu_time = -np.inf, 0.0
        if not self._sinks:
            return
        logged, config = log is not None, scenario.recording
        pictures = config.image_rate if logged and config.content == "full" else 0.0
        # Often enough that each sample is in the port's vector at least once.
        imu_rate = 2 / IMU_DEPTH * scenario.imu.rate if scenario.estimator == VIO else 0.0
        for rate, look in (
            (config.state_rate if logged else _PAGE_RATE, self._sample_state),
            (config.pose_rate if logged else 0.0, self._sample_pose),
            (imu_rate if logged else 0.0, self._sample_imu),
            (scenario.camera.fps if logged else _PAGE_CHANGES, self._look_for_changes),
            (pictures or (_PAGE_PICTURES if page else 0.0), self._look_at_picture),
        ):
            if rate:
                self.DeclarePeriodicPublishEvent(1 / rate, 0.0, look)
        self.DeclareForcedPublishEvent(self._look_last)

    def close(self) -> None:
        """Ends the log.

        Raises:
            UserError: if it cannot be written.
        """
        if self._log is not None:
            self._log.close()

    def look(self, root_context: Context) -> Iterator[RaceEvent]:
        """Yields what has changed since the last call, and then where the drone is.

        Args:
            root_context: of the diagram that the observer is in.
        """
        context = self.GetMyContextFromRoot(root_context)
        time, value_of = context.get_time(), self._values(context)
        yield from self._for_result.events(time, value_of)
        truth = as_plant_state(value_of("truth.state"), time)
        yield events.StateSample(time, truth, drone=self._drone)

    def _values(self, context):
        """Returns what returns the value of a port by its name; None if there is no such port."""
        ports = self._ports
        return lambda name: ports[name].Eval(context) if name in ports else None

    def _tell(self, *happened):
        for event in happened:
            for sink in self._sinks:
                sink(event)

    def _sample_state(self, context):
        self._state_time = time = context.get_time()
        value_of = self._values(context)
        estimate, filtered, disturbance, imu, reference, speeds, commands = map(value_of, _SAMPLED)
        sample = events.StateSample(
            time,
            as_plant_state(value_of("truth.state"), time),
            estimate=None if estimate is None else as_state(estimate),
            filtered=None if filtered is None else as_state(filtered),
            disturbance=disturbance,
            imu=imu,
            reference=None if reference is None else as_reference(reference),
            rotor_speeds=speeds,
            rotor_commands=commands,
            drone=self._drone,
        )
        self._tell(sample)

    def _sample_pose(self, context):
        time, value_of = context.get_time(), self._values(context)
        info = value_of("camera_info")
        if info is not None:
            truth = as_plant_state(value_of("truth.state"), time)
            self._tell(events.PoseSample(time, truth, info.X_BC, drone=self._drone))

    def _sample_imu(self, context):
        rows = self._values(context)("imu").reshape(-1, IMU_ROW)
        new = rows[rows[:, 0] > self._imu_time][::-1]
        if len(new):
            self._imu_time = new[-1, 0]
            self._tell(events.ImuSampled(context.get_time(), new, drone=self._drone))

    def _look_for_changes(self, context):
        self._tell(*self._for_log.events(context.get_time(), self._values(context)))

    def _look_at_picture(self, context):
        time, value_of = context.get_time(), self._values(context)
        view, taken, info = map(value_of, _CAMERA)
        if info is not None:
            # A picture is told after what was found in it.
            self._tell(*self._for_log.detections(time, value_of))
            self._tell(events.Picture(time, float(taken[0]), view, info, drone=self._drone))

    def _look_last(self, context):
        if context.get_time() > self._state_time + 1e-6:
            self._sample_state(context)
        self._look_for_changes(context)


def AddRaceObserver(
    builder: DiagramBuilder,
    scenario: Scenario,
    simulation: Diagram,
    autonomy: Diagram,
    log: LogSink | None,
    page: Sequence[Sink],
) -> RaceObserver:
    """Adds what observes a race, and connects it to all that the two diagrams tell.

    Args: builder: of the race. simulation, autonomy: in it. The others: see RaceObserver.
    """
    names = ("truth.state", *_SAMPLED, *_CAMERA, *_KEYS)
    sources = {
        name: source.GetOutputPort(name)
        for source in (autonomy, simulation)
        for name in names
        if source.HasOutputPort(name)
    }
    sizes = {
        name: source.size() if source.get_data_type() == PortDataType.kVectorValued else None
        for name, source in sources.items()
    }
    observer = RaceObserver(sizes, scenario, log, page)
    builder.AddNamedSystem(_NAME, observer)
    for name, source in sources.items():
        builder.Connect(source, observer.GetInputPort(name))
    return observer
