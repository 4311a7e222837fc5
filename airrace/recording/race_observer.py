"""Watches the ports of a race, and passes on what happens to sinks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, PortDataType

from airrace.recording import race_events as events
from airrace.recording.log_sink import LogSink
from airrace.recording.race_changes import FOR_LOG, FOR_RESULT, KEYS, Changes
from airrace.recording.race_events import DRONE, RaceEvent, Sink
from airrace.scenario import Scenario
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.sensing.imu_samples import IMU_DEPTH, SAMPLE_SIZE
from airrace.trajopt.reference import as_reference
from airrace.vehicle.state import as_plant_state, as_state

_NAME = "race_observer"
_PAGE_RATE, _PAGE_CHANGES, _PAGE_PICTURES = 30.0, 10.0, 5.0  # Hz, if there is no log
_MAP_PERIOD = 1.0  # s, between two maps, unless a lap has ended
# Field of a StateSample to its port, and what makes the field of the port's vector.
_SAMPLED: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "estimate": ("state_estimate", as_state),
    "filtered": ("filtered_estimate", as_state),
    "disturbance": ("disturbance", np.asarray),
    "imu": ("imu", np.asarray),
    "reference": ("reference", as_reference),
    "rotor_speeds": ("rotor_speeds", np.asarray),
    "rotor_commands": ("rotor_speed_command", np.asarray),
}
_CAMERA = ("camera_view", "camera_image_time", "camera_info")


class RaceObserver(LeafSystem):
    """Makes events of what crosses a race's ports, see race_events.py, and passes them to sinks.

    .. pydrake_system::

        name: RaceObserver
        input_ports:
        - truth.state
        - truth.referee_status, truth.gate_shifts, truth.contacts
        - state_estimate, filtered_estimate, disturbance, imu, reference
        - rotor_speeds, rotor_speed_command, rotor_losses, negative_thrusts
        - camera_view, camera_image_time, camera_info, detections
        - slam_state, gate_map, lap_plan, path_clock, explorer_status, policy_status

    All are as the systems that they come from describe them; all but the first may be missing. The
    log and the page get events at their rates. The loop that flies the race asks for what has
    changed, with look(). Nothing in the race depends on the observer: it only publishes, and what
    it remembers is what it has published.
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
            log: a sink, which close() closes.
            page: other sinks.
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
        # Of what was published last. It is output, not state: see the class.
        self._for_log = Changes(FOR_LOG, drone, _MAP_PERIOD)
        self._for_result = Changes(FOR_RESULT, drone)
        self._state_time, self._imu_time = -np.inf, 0.0
        if not self._sinks:
            return
        logged, config = log is not None, scenario.recording
        pictures = config.image_rate if logged and config.content == "full" else 0.0
        # Often enough that each sample is in the port's vector at least once.
        imu_rate = 2 / IMU_DEPTH * scenario.imu.rate if scenario.localizes else 0.0
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
        truth = as_plant_state(value_of("truth.state"))._replace(time=time)
        yield events.StateSample(time, truth, drone=self._drone)

    def _values(self, context):
        """Returns what returns the value of a port by its name; None if there is no such port."""
        ports = self._ports
        return lambda name: ports[name].Eval(context) if name in ports else None

    def _publish(self, *happened):
        for event in happened:
            for sink in self._sinks:
                sink(event)

    def _sample_state(self, context):
        self._state_time = time = context.get_time()
        value_of = self._values(context)
        truth = as_plant_state(value_of("truth.state"))._replace(time=time)
        fields = {
            field: make(vector)
            for field, (port, make) in _SAMPLED.items()
            if (vector := value_of(port)) is not None
        }
        self._publish(events.StateSample(time, truth, drone=self._drone, **fields))

    def _sample_pose(self, context):
        time, value_of = context.get_time(), self._values(context)
        info = value_of("camera_info")
        if info is not None:
            truth = as_plant_state(value_of("truth.state"))._replace(time=time)
            self._publish(events.PoseSample(time, truth, info.X_BC, drone=self._drone))

    def _sample_imu(self, context):
        rows = self._values(context)("imu").reshape(-1, SAMPLE_SIZE)
        new = rows[rows[:, 0] > self._imu_time][::-1]
        if len(new):
            self._imu_time = new[-1, 0]
            self._publish(events.ImuSampled(context.get_time(), new, drone=self._drone))

    def _look_for_changes(self, context):
        self._publish(*self._for_log.events(context.get_time(), self._values(context)))

    def _look_at_picture(self, context):
        time, value_of = context.get_time(), self._values(context)
        view, taken, info = map(value_of, _CAMERA)
        if info is not None:
            # A picture comes after what was found in it.
            self._publish(*self._for_log.detections(time, value_of))
            self._publish(events.Picture(time, float(taken[0]), view, info, drone=self._drone))

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
    sampled = [port for port, _ in _SAMPLED.values()]
    names = ("truth.state", *sampled, *_CAMERA, *KEYS)
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
