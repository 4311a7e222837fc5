"""A world for explorers without pixels: perfect flight, geometric sight."""

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from airrace.systems.marker_statistics import MarkerStatistics, make_map
from airrace.systems.types import Detection, Detections, ExplorerStatus, GateMap
from airrace.trajopt import flat_trajectory as ref


class KinematicWorld(LeafSystem):
    """Follows the explorer's reference exactly and sees what a camera would.

    A marker is seen within `sight` metres, 60 degrees off its normal and 40
    degrees off the camera's axis.
    """

    def __init__(self, track, sight=32.0, hidden=lambda id, p: False, rate=20.0):
        LeafSystem.__init__(self)
        self._boards = track.boards()
        self._sight, self._hidden = sight, hidden
        x, y, z = track.start.position
        self._pose = np.array([x, y, z + 0.1, np.deg2rad(track.start.heading_deg)])
        self._velocity = np.zeros(3)
        self._counts = {}
        self.passed = []
        self._detections, self._map = Detections(), GateMap()
        self._reference = self.DeclareVectorInputPort("exploration_reference", ref.SIZE)
        now = {self.time_ticket()}  # and nothing of the input: no loop
        self.DeclareVectorOutputPort("state_estimate", 14, self._CalcEstimate, now)
        self.DeclareAbstractOutputPort(
            "detections", lambda: Value[object](Detections()),
            lambda c, o: o.set_value(self._detections), now)
        self.DeclareAbstractOutputPort(
            "gate_map", lambda: Value[object](GateMap()), lambda c, o: o.set_value(self._map), now)
        self.DeclarePeriodicPublishEvent(1 / rate, 0.5 / rate, self._Look)

    def _CalcEstimate(self, context, output):
        q = RollPitchYaw(0, 0, self._pose[3]).ToQuaternion().wxyz()
        output.set_value([context.get_time(), *q, *self._pose[:3], 0, 0, 0, *self._velocity])

    def _Look(self, context):
        r = self._reference.Eval(context)
        self._pose = np.array([*r[ref.POSITION], r[ref.YAW]])
        self._velocity = r[ref.VELOCITY]
        self.passed.append(self._pose.copy())
        markers = tuple(
            Detection(b.id, np.zeros((4, 2)), RigidTransform(), 0.0)
            for b in self._boards if self._sees(b)
        )
        for marker in markers:
            self._counts[marker.id] = self._counts.get(marker.id, 0) + 1
        self._detections = Detections(context.get_time(), markers)
        statistics = {
            b.id: MarkerStatistics(
                self._counts[b.id], 0, b.X_WM.translation(), np.zeros(3),
                self._counts[b.id] * b.X_WM.rotation().col(2))
            for b in self._boards if b.id in self._counts
        }
        self._map = make_map(
            statistics, min_sightings=3, time=context.get_time(), detections=0, out_of_range=0)

    def _sees(self, board):
        ray = board.X_WM.translation() - self._pose[:3]
        distance = np.linalg.norm(ray)
        axis = np.array([np.cos(self._pose[3]), np.sin(self._pose[3]), 0.0])
        return (
            distance < self._sight
            and -(ray @ board.X_WM.rotation().col(2)) > 0.5 * distance
            and ray @ axis > np.cos(np.deg2rad(40)) * distance
            and not self._hidden(board.id, self._pose)
        )


def explore(explorer, world, seconds=300.0):
    """Explores until done; returns the statuses in order and the path."""
    builder = DiagramBuilder()
    builder.AddSystem(explorer)
    builder.AddSystem(world)
    for name in ("detections", "gate_map", "state_estimate"):
        builder.Connect(world.GetOutputPort(name), explorer.GetInputPort(name))
    builder.Connect(
        explorer.GetOutputPort("exploration_reference"),
        world.GetInputPort("exploration_reference"),
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = explorer.GetMyContextFromRoot(simulator.get_context())
    statuses = [ExplorerStatus()]
    while not statuses[-1].done and simulator.get_context().get_time() < seconds:
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.05)
        status = explorer.GetOutputPort("explorer_status").Eval(context)
        if (status.state, status.since) != (statuses[-1].state, statuses[-1].since):
            statuses.append(status)
    return statuses, np.array(world.passed)
