"""The simulator's end of the interface: what is sent when, and what commands do."""

import functools
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U
from pymavlink.dialects.v20 import common as mavlink

from airrace.common.packing import Packing
from airrace.math.quaternion import rotation_matrix
from airrace.math.random import make_generator
from airrace.mavlink import telemetry
from airrace.mavlink.client_link import ClientLink
from airrace.mavlink.commands import ARM, RESET, SET_MODE, SETPOINTS, RefusedError, setpoint_of
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
HEARTBEAT_RATE, ACTUATOR_RATE, STATUS_RATE, TRACK_RATE = 10.0, 96.0, 4.0, 1.0
ATTITUDE_RATE, POSITION_RATE, ODOMETRY_RATE = 114.0, 93.0, 72.0
LISTEN_RATE = 500.0
# s: a publish event sees what was sampled before its time, so it comes a little after a sample.
AFTER = 0.001
_ON_PAD = ExplorerStatus(state="ON_PAD", reason="waiting for the client to arm")


class Flight(NamedTuple):
    """What the bridge remembers, beside the set-point in force."""

    started: float  # when the drone was first armed (s), -1 before
    origin: np.ndarray  # of LOCAL_NED, where it was armed last (m), (3,)


_FLIGHT = Packing(Flight, origin=3)


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
    ``setpoint`` is what the client wants, a Setpoint (24). ``explorer_status`` is an
    ExplorerStatus, which is done once the drone was armed: from then on the referee counts gates.

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
    ):
        """Args: start: where the drone stands before it is armed (m), (3,). link: to the client."""
        LeafSystem.__init__(self)
        self._scenario, self._track, self._vehicle, self._link = scenario, track, vehicle, link
        self._config, self._quirks = scenario.mavlink, scenario.mavlink.quirks
        self.reset_wanted, self.imu_messages, self.commands = False, 0, 0
        self._declare_ports(start)
        # What was sent last. It is output, not state: nothing in the flight depends on it.
        self._imu_time = self._picture_time = -1.0
        self._frames, self._contacts = 0, (0.0, 0.0)
        self._jpeg = b""
        self._imu_random = make_generator(scenario.seed, "mavlink imu")
        self._second, self._drop = -1, 0.0
        self._picture_random = make_generator(scenario.seed, "mavlink pictures")
        for rate, send in self._timetable():
            self.DeclarePeriodicPublishEvent(1.0 / rate, AFTER, send)
        self.DeclarePeriodicPublishEvent(1.0 / LISTEN_RATE, 0.0, self._listen)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / LISTEN_RATE, 0.0, self._obey)

    def _declare_ports(self, start):
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
        self._flight = self.DeclareDiscreteState(_FLIGHT.vector(Flight(-1.0, start)))
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

    def started(self, context: Context) -> float:
        """Returns when it was first armed (s), -1 before; context: of this system."""
        return float(self._remembered(context).started)

    def greet(self) -> None:
        """Sends a HEARTBEAT while the time does not go on yet."""
        self._link.send(telemetry.heartbeat(armed=False))

    def _remembered(self, context: Context) -> Flight:
        return _FLIGHT.parts(context.get_discrete_state(self._flight).value())

    def _clock(self, time):
        return Clock(time, self._quirks.clock_offset)

    def _now(self, context):
        return self._clock(context.get_time())

    # What the client is told.

    def _send_heartbeat(self, context):
        self._link.send(telemetry.heartbeat(self.armed(context)))

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
        inverted = self._quirks.inverted_rates
        self._link.send(telemetry.highres_imu(self._clock(time), force, rates, inverted))

    def _send_actuators(self, context):
        vehicle = self._vehicle
        thrusts = vehicle.thrust_coefficients * np.square(read_vector(self._rotors, context))
        self._link.send(telemetry.actuators(self._now(context), thrusts / vehicle.max_thrusts))

    def _send_status(self, context):
        started, status = self.started(context), self._referee.Eval(context)
        gates = len(self._track.gates)
        self._link.send(telemetry.race_status(self._now(context), started, status, gates))

    def _send_track(self, context):
        hidden, origin = self._config.vq != 1, self._remembered(context).origin
        for message in telemetry.track_messages(self._track, origin, hidden):
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
        return ned_state(state, R_WB, self._remembered(context).origin)

    def _send_attitude(self, context):
        inverted, wrong = self._quirks.inverted_rates, self._quirks.wrong_signs
        message = telemetry.attitude(self._now(context), self._ned(context), inverted, wrong)
        self._link.send(message)

    def _send_position(self, context):
        self._link.send(telemetry.local_position(self._now(context), self._ned(context)))

    def _send_odometry(self, context):
        inverted, wrong = self._quirks.inverted_rates, self._quirks.wrong_signs
        message = telemetry.odometry(self._now(context), self._ned(context), inverted, wrong)
        self._link.send(message)

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
            self._jpeg = telemetry.encode_picture(picture, self._config.jpeg_quality)
        size, time_ns = self._config.chunk_size, self._clock(taken).ns
        for datagram in telemetry.picture_datagrams(frame, time_ns, self._jpeg, size):
            for _ in range(2 if self._quirks.doubled_pictures else 1):
                self._link.send_picture(datagram)

    # What the client says.

    def _listen(self, _context):
        self._link.drain()

    def _obey(self, context, discrete_state):
        for message in self._link.take():
            kind = message.get_type()
            self.commands += is_command(message)
            if kind == "TIMESYNC":
                self._link.send(telemetry.timesync(message, self._now(context)))
            elif kind == "COMMAND_LONG":
                self._command(context, discrete_state, message)
            elif kind in SETPOINTS:
                self._follow(context, discrete_state, message)

    def _command(self, context, discrete_state, message):
        result = mavlink.MAV_RESULT_ACCEPTED
        if message.command not in (ARM, RESET, SET_MODE):
            result = mavlink.MAV_RESULT_UNSUPPORTED
        elif message.command == ARM and message.param1 not in (0.0, 1.0):
            # What is not a number must not disarm a drone that flies.
            result = mavlink.MAV_RESULT_DENIED
            self._link.counts.refused += 1
        self._link.send(mavlink.MAVLink_command_ack_message(message.command, result))
        if result != mavlink.MAV_RESULT_ACCEPTED:
            return
        if message.command == RESET:
            self.reset_wanted = True
        elif message.command == ARM:
            setpoint = discrete_state.get_mutable_value(self._setpoint)
            wanted, arms = as_setpoint(setpoint), message.param1 == 1.0
            if arms and not wanted.armed:
                flight, time = discrete_state.get_mutable_value(self._flight), context.get_time()
                position = as_plant_state(read_vector(self._state, context)).position
                started = _FLIGHT.parts(flight).started
                flight[:] = _FLIGHT.vector(Flight(time if started < 0.0 else started, position))
                idle = NO_SETPOINT._replace(kind=IDLE, time=time, armed=1.0)
                setpoint[:] = setpoint_vector(idle)
            elif not arms:
                setpoint[:] = setpoint_vector(NO_SETPOINT)

    def _follow(self, context, discrete_state, message):
        setpoint = discrete_state.get_mutable_value(self._setpoint)
        origin = _FLIGHT.parts(discrete_state.value(self._flight)).origin
        try:
            wanted = setpoint_of(message, origin, self._quirks.inverted_rates)
        except RefusedError:
            self._link.counts.refused += 1
            return
        armed = as_setpoint(setpoint).armed
        setpoint[:] = setpoint_vector(wanted._replace(time=context.get_time(), armed=armed))

    def _calc_status(self, context, output):
        started = self.started(context)
        output.set_value(_ON_PAD if started < 0.0 else _racing(started))


@functools.lru_cache(maxsize=4)  # whoever looks for changes compares objects
def _racing(started: float) -> ExplorerStatus:
    return ExplorerStatus(state="RACE", reason="armed by the client", since=started, done=True)


def is_command(message: Any) -> bool:
    """Whether a message is one that `--step` waits for."""
    kind = message.get_type()
    return kind in SETPOINTS or (kind == "COMMAND_LONG" and message.command in (ARM, RESET))
