"""The simulator's end of the interface: what is sent when, and what commands do."""

import functools
import itertools
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U
from pymavlink.dialects.v20 import common as mavlink

from airrace.common.packing import Packing
from airrace.math.quaternion import reference_yaw, rotation_matrix
from airrace.math.random import make_generator
from airrace.mavlink import telemetry
from airrace.mavlink.client_link import ClientLink, controls, is_for_us
from airrace.mavlink.commands import (
    ARM,
    RESET,
    SET_MODE,
    SETPOINTS,
    RefusedError,
    Situation,
    make_airframe,
    setpoint_of,
)
from airrace.mavlink.dialects import DIALECTS
from airrace.mavlink.frames import ned_state
from airrace.mavlink.telemetry import Clock
from airrace.scenario import Scenario
from airrace.systems.control.setpoint import IDLE, NO_SETPOINT, as_setpoint, setpoint_vector
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.contact_sensor import CONTACT_RATE, CONTACTS_SIZE, GATE, as_contacts
from airrace.systems.sensing.imu_samples import IMU_SIZE, as_samples
from airrace.systems.types import ExplorerStatus, RefereeStatus
from airrace.track import Course
from airrace.vehicle import Vehicle
from airrace.vehicle.state import STATE_SIZE, as_plant_state

# Hz, of simulated time.
HEARTBEAT_RATE, ACTUATOR_RATE, STATUS_RATE, TRACK_RATE = 10.0, 96.0, 4.0, 10.0
ATTITUDE_RATE, POSITION_RATE, ODOMETRY_RATE = 114.0, 93.0, 72.0
LISTEN_RATE = 500.0
# s: a publish event sees what was sampled before its time, so it comes a little after a sample.
AFTER = 0.001
_ON_PAD = ExplorerStatus(state="ON_PAD", reason="waiting for the client to arm")
_NEVER, _MOST_COMPLAINTS = -1.0, 50
EARLY_START = "disqualified: it left its pad before the start"


class Flight(NamedTuple):
    """What the bridge remembers, beside the set-point in force."""

    start: float  # of the race (s), maybe to come; -1 before the countdown
    begun: float  # 1 once it was
    early: float  # when the drone left its pad before (s), -1 if it has not
    pad: np.ndarray  # where it stood when the countdown began (m), (3,)


_FLIGHT = Packing(Flight, pad=3)


class MavlinkBridge(LeafSystem):
    """Talks to a client in MAVLink, and sends it pictures.

    .. pydrake_system::

        name: MavlinkBridge
        input_ports:
        - imu
        - truth.state
        - rotor_speeds
        - camera_image
        - camera_image_time
        - truth.contacts
        - truth.referee_status
        output_ports:
        - setpoint
        - explorer_status

    Its inputs are the Simulation's outputs of these names; ``truth.contacts`` is of Contacts (9).
    ``setpoint`` is what the client wants, a Setpoint (33). ``explorer_status`` is an
    ExplorerStatus, which is done once the race has begun: from then on the referee counts gates.

    The first arming, or the simulator itself, begins a countdown, and at its end the race. What a
    countdown is, and what the numbers on the wire mean, says the scenario's Dialect.

    What came is read at LISTEN_RATE, in a publish event; the update of the same time obeys and
    answers it, also what was read between two of them. All else is sent by the clock, in simulated
    time. The link is outside of the Context, as the world is.

    Attributes:
        reset_wanted: whether the client has asked to begin anew.
        imu_messages: how many HIGHRES_IMU were sent.
        commands: how many commands were taken up, whether they could be obeyed or not.
    """

    def __init__(
        self,
        *,
        scenario: Scenario,
        track: Course,
        vehicle: Vehicle,
        start: np.ndarray,
        link: ClientLink,
        before: float | None = None,
    ):
        """Constructs the bridge.

        Args:
            start: where the drone stands, and LOCAL_NED begins (m), (3,).
            link: to the client.
            before: how long races in the same process have lasted (s), None for the first.
        """
        LeafSystem.__init__(self)
        self._dialect, self._origin = DIALECTS[scenario.mavlink.dialect], start
        self._ready = self._dialect.loading if before is None else self._dialect.settling
        self._ahead = scenario.mavlink.quirks.clock_offset
        self._ahead += (before or 0.0) * self._dialect.clock_goes_on
        self._airframe = make_airframe(vehicle, self._dialect)
        self._scenario, self._track, self._vehicle, self._link = scenario, track, vehicle, link
        self._config, self._quirks = scenario.mavlink, scenario.mavlink.quirks
        self.reset_wanted, self.imu_messages, self.commands = False, 0, 0
        self._declare_ports()
        # What was sent last. It is output, not state: nothing in the flight depends on it.
        self._imu_time = self._picture_time = -1.0
        self._frames, self._contacts = 0, (0.0, 0.0)
        self._track_told: Any = None  # when (s), and to whom
        self._complaints: set[str] = set()
        self._jpeg = b""
        self._imu_random = make_generator(scenario.seed, "mavlink imu")
        self._second, self._drop = -1, 0.0
        self._picture_random = make_generator(scenario.seed, "mavlink pictures")
        for rate, send in self._timetable():
            self.DeclarePeriodicPublishEvent(1.0 / rate, AFTER, send)
        self.DeclarePeriodicPublishEvent(1.0 / LISTEN_RATE, 0.0, self._listen)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / LISTEN_RATE, 0.0, self._obey)

    def _declare_ports(self):
        n = len(self._vehicle.rotors)
        self._imu = self.DeclareVectorInputPort("imu", IMU_SIZE)
        self._state = self.DeclareVectorInputPort("truth.state", STATE_SIZE - 1)
        self._rotors = self.DeclareVectorInputPort("rotor_speeds", n)
        self._image = self.DeclareAbstractInputPort("camera_image", Value(ImageRgba8U(1, 1)))
        self._taken = self.DeclareVectorInputPort("camera_image_time", 1)
        self._touched = self.DeclareVectorInputPort("truth.contacts", CONTACTS_SIZE)
        self._referee = self.DeclareAbstractInputPort(
            "truth.referee_status", Value[object](RefereeStatus((), False, None, None, 0))
        )
        self._setpoint = self.DeclareDiscreteState(setpoint_vector(NO_SETPOINT))
        self._flight = self.DeclareDiscreteState(
            _FLIGHT.vector(Flight(_NEVER, 0.0, _NEVER, self._origin))
        )
        self.DeclareStateOutputPort("setpoint", self._setpoint)
        self.DeclareAbstractOutputPort(
            "explorer_status",
            lambda: Value[object](_ON_PAD),
            self._calc_status,
            {self.discrete_state_ticket(self._flight)},
        )

    def _timetable(self):
        """Returns pairs of a rate (Hz) and what is sent then; at equal times, in this order."""
        telling = [
            (self._scenario.camera.fps, self._send_picture),  # before the IMU's
            (HEARTBEAT_RATE, self._send_heartbeat),
            (ACTUATOR_RATE, self._send_actuators),
            (STATUS_RATE, self._send_status),
            (TRACK_RATE, self._send_track),
            (CONTACT_RATE, self._send_collision),
        ]
        if self._config.vq == 1:
            telling += [
                (ATTITUDE_RATE, self._send_attitude),
                (POSITION_RATE, self._send_position),
                (ODOMETRY_RATE, self._send_odometry),
            ]
        return [*telling, (self._scenario.imu.rate, self._send_imu)]

    def armed(self, context: Context) -> bool:
        """Whether the drone is armed; context: of this system."""
        return bool(as_setpoint(context.get_discrete_state(self._setpoint).value()).armed)

    def finished(self, context: Context) -> bool:
        """Returns whether the drone has passed its last gate, of which the client hears soon."""
        return self._referee.Eval(context).finished

    def flight(self, context: Context) -> Flight:
        """Returns the Flight so far; context: of this system."""
        return _FLIGHT.parts(context.get_discrete_state(self._flight).value())

    def greet(self) -> None:
        """Sends a HEARTBEAT while the time does not go on yet."""
        self._link.send(telemetry.heartbeat(self._dialect, armed=False))

    def _clock(self, time):
        return Clock(time, self._ahead, self._dialect.epoch_ns)

    def _now(self, context):
        return self._clock(context.get_time())

    # What the client is told.

    def _send_heartbeat(self, context):
        self._link.send(telemetry.heartbeat(self._dialect, self.armed(context)))

    def _send_imu(self, context):
        samples = as_samples(read_vector(self._imu, context))
        time = samples.time[0]
        if time < 0.0 or time == self._imu_time:
            return
        self._imu_time = time
        lost = self._imu_random.random()
        if int(time) != self._second:  # load takes another share of samples every second
            self._second = int(time)
            self._drop = self._quirks.imu_drop * self._imu_random.random()
        if lost < self._drop:
            return
        self.imu_messages += 1
        force, rates = samples.specific_force[0], samples.angular_velocity[0]
        self._link.send(telemetry.highres_imu(self._dialect, self._clock(time), force, rates))

    def _send_actuators(self, context):
        vehicle = self._vehicle
        thrusts = vehicle.thrust_coefficients * np.square(read_vector(self._rotors, context))
        shares = (thrusts / vehicle.max_thrusts)[self._airframe.rotors]
        self._link.send(telemetry.actuators(self._now(context), shares))

    def _send_status(self, context):
        start, status = float(self.flight(context).start), self._referee.Eval(context)
        if context.get_time() < start - self._dialect.countdown - AFTER:
            start = -1.0  # armed, but the countdown is still to come
        gates = len(self._track.gates)
        self._link.send(telemetry.race_status(self._now(context), start, status, gates))

    def _send_track(self, context):
        """Sends the track when it is due, and to a client that has come since."""
        dialect, time, client = self._dialect, context.get_time(), self._link.client
        if time < min(dialect.track_at, self._ready):
            return
        if self._track_told is not None:
            told, whom = self._track_told
            again = dialect.track_period and time > told + dialect.track_period - AFTER
            if not again and whom == client:
                return
        self._track_told = time, client
        hidden = self._config.vq != 1
        for message in telemetry.track_messages(dialect, self._track, self._origin, hidden):
            self._link.send(message)

    def _send_collision(self, context):
        contacts = as_contacts(read_vector(self._touched, context))
        counts = float(contacts.gates), float(contacts.environment)
        if counts != self._contacts:
            self._contacts = counts
            is_gate = contacts.kind == GATE
            message = telemetry.collision(self._now(context), is_gate, float(contacts.impulse))
            self._link.send(message)

    def _ned(self, context):
        state = as_plant_state(read_vector(self._state, context))
        R_WB = rotation_matrix(np.array(state.quaternion))
        return ned_state(state, R_WB, self._origin)

    def _send_attitude(self, context):
        now, ned = self._now(context), self._ned(context)
        self._link.send(telemetry.attitude(self._dialect, now, ned))

    def _send_position(self, context):
        self._link.send(telemetry.local_position(self._now(context), self._ned(context)))

    def _send_odometry(self, context):
        now, ned = self._now(context), self._ned(context)
        self._link.send(telemetry.odometry(self._dialect, now, ned))

    def _send_picture(self, context):
        (taken,) = self._taken.Eval(context)
        if taken < 0.0 or taken == self._picture_time:
            return
        self._picture_time = taken
        frame, self._frames = self._frames, self._frames + 1
        lost, repeated = self._picture_random.random(2)
        if lost < self._quirks.lost_pictures:
            return
        if not (self._jpeg and repeated < self._quirks.repeated_pictures):
            picture = self._image.Eval(context).data
            quality, size = self._config.jpeg_quality, self._dialect.jpeg_size
            self._jpeg = telemetry.encode_picture(picture, quality, size)
        size, time_ns = self._config.chunk_size, self._clock(taken).epoch_ns
        for datagram in telemetry.picture_datagrams(frame, time_ns, self._jpeg, size):
            for _ in range(self._dialect.picture_copies):
                self._link.send_picture(datagram)

    # What the client says.

    def _listen(self, context):
        self._link.time = context.get_time()
        self._link.drain()

    def _obey(self, context, discrete_state):
        self._watch_start(context, discrete_state)
        messages = [message for message in self._link.take() if is_for_us(message)]
        for message, after in itertools.zip_longest(messages, messages[1:]):
            kind = message.get_type()
            self.commands += is_command(message)
            if kind == "TIMESYNC":
                self._link.send(telemetry.timesync(message, self._now(context)))
            elif kind == "COMMAND_LONG":
                self._command(context, discrete_state, message)
            elif kind in SETPOINTS and not _is_replaced(message, after):
                self._follow(context, discrete_state, message)

    def _watch_start(self, context, discrete_state):
        """Begins the race when it is time, and sees whether the drone has left its pad before."""
        memory, time = discrete_state.get_mutable_value(self._flight), context.get_time()
        flight = _FLIGHT.parts(memory)
        is_due = self._dialect.starts_itself and time >= self._ready and self._link.heard
        if flight.start < 0.0 and is_due:
            self._count_down(context, memory)
        if flight.start < 0.0 or flight.begun:
            return
        place = as_plant_state(read_vector(self._state, context)).position
        off = float(np.linalg.norm(place - flight.pad))
        if self._dialect.early and off > self._dialect.early and flight.early < 0.0:
            memory[:] = _FLIGHT.vector(flight._replace(early=time))
            self._complain(EARLY_START)
        elif time >= flight.start:
            memory[:] = _FLIGHT.vector(flight._replace(begun=1.0))

    def _command(self, context, discrete_state, message):
        result, why = mavlink.MAV_RESULT_ACCEPTED, None
        if message.command not in (ARM, RESET, SET_MODE):
            result = mavlink.MAV_RESULT_UNSUPPORTED
        elif message.command == ARM and message.param1 not in (0.0, 1.0):
            # What is not a number must not disarm a drone that flies.
            result, why = mavlink.MAV_RESULT_DENIED, "param1 of command 400 must be 0 or 1"
        self._link.send(mavlink.MAVLink_command_ack_message(message.command, result))
        if why is not None:
            self._link.counts.refused += 1
            self._complain(why)
        elif message.command == RESET:
            self.reset_wanted = True
        elif message.command == ARM:
            setpoint = discrete_state.get_mutable_value(self._setpoint)
            if message.param1 != 1.0:
                setpoint[:] = setpoint_vector(NO_SETPOINT)
            elif not as_setpoint(setpoint).armed:
                self._arm(context, discrete_state)

    def _arm(self, context, discrete_state):
        """Arms the drone; the first time, the countdown begins."""
        memory, time = discrete_state.get_mutable_value(self._flight), context.get_time()
        if _FLIGHT.parts(memory).start < 0.0:
            self._count_down(context, memory)
        idle = NO_SETPOINT._replace(kind=IDLE, time=time, armed=1.0)
        discrete_state.get_mutable_value(self._setpoint)[:] = setpoint_vector(idle)

    def _count_down(self, context, memory):
        """Begins the countdown, for which the drone must stay where it is."""
        time, state = context.get_time(), as_plant_state(read_vector(self._state, context))
        start = max(time, self._ready) + self._dialect.countdown
        memory[:] = _FLIGHT.vector(Flight(start, float(start <= time), _NEVER, state.position))

    def _follow(self, context, discrete_state, message):
        setpoint = discrete_state.get_mutable_value(self._setpoint)
        state, last = as_plant_state(read_vector(self._state, context)), as_setpoint(setpoint)
        yaw = reference_yaw(np.array(state.quaternion))
        situation = Situation(self._airframe, self._origin, state.position, yaw, last)
        try:
            wanted = setpoint_of(message, self._dialect, situation)
        except RefusedError as e:
            self._link.counts.refused += 1
            self._complain(str(e))
            return
        armed, time = last.armed, context.get_time()
        setpoint[:] = setpoint_vector(wanted._replace(time=time, armed=armed))

    def _complain(self, sentence):
        """Says once what cannot be done, to the client and on the terminal."""
        if sentence not in self._complaints and len(self._complaints) < _MOST_COMPLAINTS:
            self._complaints.add(sentence)
            self._link.note(f"To the client: {sentence}.")
            for message in telemetry.status_text(len(self._complaints), sentence):
                self._link.send(message)

    def _calc_status(self, context, output):
        flight = self.flight(context)
        output.set_value(_status_of(float(flight.start), bool(flight.begun)))


@functools.lru_cache(maxsize=4)  # whoever looks for changes compares objects
def _status_of(start: float, begun: bool) -> ExplorerStatus:
    if start < 0.0:
        return _ON_PAD
    if not begun:
        return ExplorerStatus(state="ON_PAD", reason=f"the race starts at {start:.1f} s")
    return ExplorerStatus(state="RACE", reason="the race has started", since=start, done=True)


def _is_replaced(message: Any, after: Any) -> bool:
    """Whether the message after a set-point, of the same moment, asks for the same things anew."""
    return (
        after is not None
        and after.get_type() == message.get_type()
        and getattr(after, "type_mask", 0) == getattr(message, "type_mask", 0)
    )


def is_command(message: Any) -> bool:
    """Whether a message is one that `--step` waits for."""
    return controls(message, (ARM, RESET))
