"""A short flight from pixels, with all that an estimator was given and what it made of it."""

import dataclasses as dc
import tempfile
from pathlib import Path

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.diagrams.race import run_race
from airrace.scenario import VIO, Scenario
from airrace.systems.sensing.imu_samples import IMU_DEPTH, IMU_SIZE
from airrace.systems.types import Detections
from airrace.vehicle.camera_info import CameraInfo
from tests.worlds.logged_race import LoggedInProcess

_RATE = 500.0  # Hz


@dc.dataclass
class RecordedFlight:
    """What was measured, and known, in a flight.

    Attributes:
        samples: of the IMU, oldest first, (n, 7), see ImuSamples.
        detections: Detections of every picture.
        camera_info: CameraInfo.
        truths: time (s) and the plant's state, (m, 14).
        states: SlamStates, one a picture.
    """

    samples: np.ndarray
    detections: list[Detections]
    camera_info: CameraInfo
    truths: np.ndarray
    states: list

    def truth_at(self, time: float) -> np.ndarray:
        """Returns the true state (14,) that was written down nearest to a time (s)."""
        return self.truths[np.argmin(np.abs(self.truths[:, 0] - time))]


class _Tape(LeafSystem):
    """Keeps the values of some ports."""

    def __init__(self, fps: float):
        LeafSystem.__init__(self)
        self.samples, self.truths, self.detections, self.states = [], [], [], []
        self.camera_info = None
        for name, size in (("imu", IMU_SIZE), ("truth.state", 13)):
            self.DeclareVectorInputPort(name, size)
        for name in ("detections", "slam_state", "camera_info"):
            self.DeclareAbstractInputPort(name, Value[object]())
        self.DeclarePeriodicPublishEvent(1.0 / _RATE, 0.0, self._write_vectors)
        self.DeclarePeriodicPublishEvent(1.0 / fps, 0.0, self._write_values)

    def _value(self, context, name):
        return self.GetInputPort(name).Eval(context)

    def _write_vectors(self, context):
        row = self._value(context, "imu").reshape(IMU_DEPTH, -1)[0]
        if row[0] > (self.samples[-1][0] if self.samples else 0.0):
            self.samples.append(row)
        self.truths.append([context.get_time(), *self._value(context, "truth.state")])

    def _write_values(self, context):
        self.camera_info = self._value(context, "camera_info")
        detections, state = (self._value(context, each) for each in ("detections", "slam_state"))
        if not self.detections or detections is not self.detections[-1]:
            self.detections.append(detections)
        if not self.states or state is not self.states[-1]:
            self.states.append(state)


def record_flight(seconds: float, **fields) -> RecordedFlight:
    """Flies the beginning of a race with the estimator ``vio``.

    Args:
        seconds: how long.
        fields: of the Scenario.
    """
    scenario = Scenario(estimator=VIO, laps=1, **fields)
    scenario.referee.time_limit = seconds
    scenario.recording.content = "none"
    transport = LoggedInProcess(lambda _: _Tape(scenario.camera.fps))
    with tempfile.TemporaryDirectory() as folder:
        run_race(scenario, Path(folder), transport=transport)
    tape = transport.log
    return RecordedFlight(
        samples=np.array(tape.samples),
        detections=tape.detections,
        camera_info=tape.camera_info,
        truths=np.array(tape.truths),
        states=tape.states,
    )
