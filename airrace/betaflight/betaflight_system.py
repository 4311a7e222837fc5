"""The flight controller of a simulated drone: the firmware, as a system."""

from collections.abc import Iterable

from airrace.betaflight.firmware_process import PERIOD, REST, FirmwareProcess
from airrace.betaflight.sticks import Sticks
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.imu_samples import AT_SAMPLE, IMU_SIZE, SAMPLE_SIZE
from airrace.vehicle.battery import Pack
from airrace.vehicle.sensor_failures import RadioFailure, failure_at
from airrace.vehicle.state import STATE_SIZE

_MOTION = slice(AT_SAMPLE.angular_velocity.start, AT_SAMPLE.specific_force.stop)  # of a sample


class Betaflight(LeafSystem):
    """Exchanges sensors and sticks for what the motors get with the firmware, each millisecond.

    .. pydrake_system::

        name: Betaflight
        input_ports:
        - rate_command
        - imu
        - rotor_speeds
        - filtered_estimate
        - state
        output_ports:
        - rotor_speed_command

    ``rate_command``: [f, w_x, w_y, w_z], total thrust (N) and rates in B (rad/s), (4,); ``imu``:
    ImuSamples (70), of which the firmware gets the newest; ``rotor_speeds`` (rad/s), (n,), by which
    the battery, if there is one, is emptied; ``filtered_estimate``: a vehicle.State (14), and
    ``state``, the true one of the plant, [q_WB, p_WB, w, v] (13), for sticks that command angles;
    ``rotor_speed_command``, held over the period: the speeds that the motors make for (rad/s),
    (n,).

    While the simulation makes a step, the firmware makes its own, from what was true at its
    beginning. So the motors hear of it one period later. The firmware remembers outside of the
    Context, and so does the battery, which would otherwise be the only one of the two to go back
    with it: time only goes forwards, and a race is built anew to be flown again.
    """

    def __init__(
        self,
        *,
        process: FirmwareProcess,
        sticks: Sticks,
        failures: Iterable[RadioFailure] = (),
        pack: Pack | None = None,
        hears_voltage: bool = True,
    ):
        """Constructs the flight controller.

        Args:
            process: of the firmware, armed.
            sticks: what its settings make of them.
            failures: when it hears no commands; its own failsafe acts then.
            pack: what drives the motors; by default, a battery that is always full.
            hears_voltage: whether who moves the sticks does.
        """
        LeafSystem.__init__(self)
        self._failures = tuple(failures)
        self._process, self._sticks = process, sticks
        self._pack, self._hears_voltage = pack, hears_voltage
        self._wanted = self.DeclareVectorInputPort("rate_command", 4)
        self._samples = self.DeclareVectorInputPort("imu", IMU_SIZE)
        self._speeds = self.DeclareVectorInputPort("rotor_speeds", sticks.rotors)
        self._estimate = self.DeclareVectorInputPort("filtered_estimate", STATE_SIZE)
        self._true = self.DeclareVectorInputPort("state", STATE_SIZE - 1)
        state = self.DeclareDiscreteState(sticks.rotors)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._step)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    def _step(self, context, discrete_state):
        newest = read_vector(self._samples, context)[:SAMPLE_SIZE]
        imu = newest[_MOTION] if newest[AT_SAMPLE.time] > 0.0 else REST
        supply = 1.0
        if self._pack is not None:
            self._pack.step(read_vector(self._speeds, context), PERIOD)
            supply = self._pack.supply
        outputs = self._process.end_step()
        discrete_state.get_mutable_value()[:] = self._sticks.rotor_speeds(outputs, supply)
        if self._failures and failure_at(self._failures, context.get_time()) is not None:
            channels = self._sticks.no_signal()
        else:
            heard = supply if self._hears_voltage else 1.0
            command = self._sticks.command_of(
                read_vector(self._wanted, context), lambda: read_vector(self._estimate, context)
            )
            channels = self._sticks.channels(command, heard)
        attitude = self._sticks.shown_attitude(lambda: read_vector(self._true, context))
        self._process.begin_step(imu, channels, attitude)
