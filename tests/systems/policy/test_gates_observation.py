"""The observation of motion and gates."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from airrace.systems.policy.gates_observation import (
    observation_size,
    opening_numbers,
    write_gates_observation,
)
from airrace.track import PYLON_HEIGHT, Gate, load_track
from airrace.vehicle.state import State

TRACK = load_track("student-airrace")
GATES = TRACK.openings()
ACTION = np.array([0.1, -0.2, 0.3, -0.4])
angles = st.floats(-3.0, 3.0)
places = st.floats(-100.0, 100.0)


def observed(position, rotation, next_gate=0, gates=2, velocity=(0, 0, 0), w=(0, 0, 0)):
    result = np.full(observation_size(gates, len(ACTION)), np.nan)
    state = State(
        0.0, rotation.ToQuaternion().wxyz(), *(np.array(x, float) for x in (position, w, velocity))
    )
    write_gates_observation(result, state, GATES, next_gate, ACTION)
    return result


@given(r=angles, p=st.floats(-1.5, 1.5), y=angles, place=st.tuples(places, places, places))
def test_corners_are_where_the_pylons_are(r, p, y, place):
    R_WB = RollPitchYaw(r, p, y).ToRotationMatrix()
    seen = observed(place, R_WB, next_gate=3)
    assert np.isfinite(seen).all()
    for k, gate in enumerate(TRACK.gates[3:5]):
        corners_B = seen[15 + 12 * k : 27 + 12 * k].reshape(4, 3)
        corners_W = corners_B @ R_WB.matrix().T + place
        up = [0.0, 0.0, PYLON_HEIGHT]
        expected = [gate.p_WL, gate.p_WR, gate.p_WR + up, gate.p_WL + up]
        np.testing.assert_allclose(corners_W, expected, atol=1e-9)


@given(r=angles, p=st.floats(-1.5, 1.5), y=angles)
def test_motion_is_in_the_axes_of_the_body(r, p, y):
    R_WB = RollPitchYaw(r, p, y).ToRotationMatrix()
    v, w = np.array([3.0, -4.0, 12.0]), np.array([0.3, 2.0, -1.0])
    seen = observed((0, 0, 5), R_WB, velocity=v, w=w)
    np.testing.assert_allclose(R_WB.matrix() @ seen[:3], v, atol=1e-9)
    np.testing.assert_allclose(seen[3:12].reshape(3, 3), R_WB.matrix(), atol=1e-9)
    np.testing.assert_allclose(R_WB.matrix() @ seen[12:15], w, atol=1e-9)
    np.testing.assert_array_equal(seen[-4:], ACTION)


def test_gates_are_counted_on_round_by_round():
    R = RollPitchYaw(0, 0, 0).ToRotationMatrix()
    last, first = observed((0, 0, 5), R, next_gate=9), observed((0, 0, 5), R, next_gate=10)
    np.testing.assert_array_equal(last[27:39], first[15:27])
    np.testing.assert_array_equal(first, observed((0, 0, 5), R, next_gate=0))


def test_flying_through_left_is_left():
    ahead = observed((0, 0, 6.25), RollPitchYaw(0, 0, 0).ToRotationMatrix())[15:27].reshape(4, 3)
    np.testing.assert_allclose(ahead[:, 0], 20.0)
    np.testing.assert_allclose(ahead[:, 1], [5, -5, -5, 5])
    np.testing.assert_allclose(ahead[:, 2], [-6.25, -6.25, 5.75, 5.75])


@given(x=places, y=places, heading=st.floats(0.0, 359.0), spacing=st.floats(5.0, 15.0))
def test_an_opening_of_the_map_is_one_of_the_track(x, y, heading, spacing):
    gate = Gate([x, y], heading, spacing)
    numbers = opening_numbers(gate.p_WG, gate.heading, gate.pylon_spacing)
    np.testing.assert_allclose(numbers, np.hstack(gate.opening()), atol=1e-12)
