"""The flight controller of a simulated drone: the firmware, as a system."""

from collections.abc import Iterable

import numpy as np

from airrace.betaflight.firmware_process import PERIOD, REST, FirmwareProcess
from airrace.betaflight.sticks import Sticks
from airrace.systems.leaf_system import LeafSystem
from airrace.systems.ports import read_vector
from airrace.systems.sensing.imu_samples import IMU_SIZE, as_samples
from airrace.vehicle.sensor_failures import RadioFailure, failure_at


class Betaflight(LeafSystem):
    """Exchanges sensors and sticks for what the motors get with the firmware, each millisecond.

    .. pydrake_system::

        name: Betaflight
        input_ports:
        - rate_command
        - imu
        output_ports:
        - rotor_speed_command

    ``rate_command``: [f, w_x, w_y, w_z], total thrust (N) and rates in B (rad/s), (4,); ``imu``:
    ImuSamples (70), of which the firmware gets the newest; ``rotor_speed_command``, held over the
    period: the speeds that the speed controllers are to reach (rad/s), (4,).

    While the simulation makes a step, the firmware makes its own, from what was true at its
    beginning. So the motors hear of it one period later. The firmware remembers outside of the
    Context: time only goes forwards, and a race is built anew to be flown again.
    """

    def __init__(
        self, *, process: FirmwareProcess, sticks: Sticks, failures: Iterable[RadioFailure] = ()
    ):
        """Constructs the flight controller.

        Args:
            process: of the firmware, armed.
            sticks: what its settings make of them.
            failures: when it hears no commands; its own failsafe acts then.
        """
        LeafSystem.__init__(self)
        self._failures = tuple(failures)
        self._process, self._sticks = process, sticks
        self._wanted = self.DeclareVectorInputPort("rate_command", 4)
        self._imu = self.DeclareVectorInputPort("imu", IMU_SIZE)
        state = self.DeclareDiscreteState(4)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._step)
        self.DeclareStateOutputPort("rotor_speed_command", state)

    def _step(self, context, discrete_state):
        samples = as_samples(read_vector(self._imu, context))
        imu = REST
        if samples.time[0] > 0.0:
            imu = np.concatenate((samples.angular_velocity[0], samples.specific_force[0]))
        outputs = self._process.end_step()
        discrete_state.get_mutable_value()[:] = self._sticks.rotor_speeds(outputs)
        if self._failures and failure_at(self._failures, context.get_time()) is not None:
            channels = self._sticks.no_signal()
        else:
            channels = self._sticks.channels(read_vector(self._wanted, context))
        self._process.begin_step(imu, channels)
