"""Contact with the frame of a square gate, and with a hall."""

import numpy as np
import pytest
from pydrake.geometry import Role

from airrace.rendering.scene.square_scenery import AddSquareScenery
from airrace.track import Start
from airrace.track.square_gate import SquareGate
from airrace.track.square_track import SquareTrack
from tests.worlds.ball import BallWorld

RADIUS = 0.1
GATES = [SquareGate([10.0, 0.0, 3.0], 0.0), SquareGate([20.0, 5.0, 4.0], 60.0, pitch_deg=-20.0)]
TRACK = SquareTrack("two", gates=GATES, start=Start([0.0, 0.0, 0.0]))


def add_course(plant):
    """Adds the course; the ball has no weight."""
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    AddSquareScenery(plant, TRACK)


@pytest.fixture(scope="module")
def world():
    return BallWorld(RADIUS, add_course)


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize(
    "y, z, side",
    [
        (0.0, 0.0, None),
        (0.6, 0.6, None),
        (-0.6, -0.6, None),
        (0.0, 0.7, "top"),
        (0.0, -0.7, "bottom"),
        (0.7, 0.0, "left"),
        (-0.7, 0.0, "right"),
        (1.3, 0.0, "left"),
        (1.5, 0.0, None),
        (0.0, 1.5, None),
    ],
)
def test_a_ball_passes_the_opening_and_hits_the_frame(world, i, y, z, side):
    gate = GATES[i]
    start = gate.X_WG @ np.array([-1.0, y, z])
    touched, _ = world.fly(start, 4.0 * gate.forward, 0.5)
    assert touched == ({f"gate_{i + 1}_{side}"} if side else set())


@pytest.mark.parametrize(
    "direction, name",
    [
        ([1.0, 0.0, 0.0], "wall_east"),
        ([-1.0, 0.0, 0.0], "wall_west"),
        ([0.0, 1.0, 0.0], "wall_north"),
        ([0.0, -1.0, 0.0], "wall_south"),
        ([0.0, 0.0, 1.0], "ceiling"),
        ([0.0, 0.0, -1.0], "ground"),
    ],
)
def test_the_hall_is_closed(world, direction, name):
    hall = TRACK.hall()
    direction = np.array(direction)
    start = np.array([5.0, -4.0, 6.5])
    sizes = np.where(direction > 0, hall.high - start, start - hall.low)
    gap = np.abs(direction) @ sizes
    touched, _ = world.fly(start, 20.0 * direction, gap / 20.0 + 0.05)
    assert touched == {name}


def test_who_looks_from_above_sees_no_roof(world):
    """The camera sees the whole hall, spectators only what is on its floor."""
    inspector = world.scene_graph.model_inspector()

    def seen(role):
        ids = inspector.GetAllGeometryIds(role)
        return {inspector.GetName(each).removesuffix("_visual") for each in ids}

    camera, spectators = seen(Role.kPerception), seen(Role.kIllustration)
    assert {"gate_1_top", "floor", "ceiling", "wall_east", "light_1"} <= camera
    assert {"gate_1_top", "floor"} <= spectators
    assert not {"ceiling", "wall_east", "light_1"} & spectators
