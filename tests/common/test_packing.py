from typing import NamedTuple

import numpy as np
import pytest

from airrace.common.jit import compiled
from airrace.common.packing import Packing


class Ball(NamedTuple):
    radius: float
    centre: np.ndarray
    spin: np.ndarray


class Track(NamedTuple):
    time: float
    points: np.ndarray
    colour: np.ndarray
    width: float


_BALL, _TRACK = Packing(Ball, centre=3, spin=(2, 2)), Packing(Track, points=(-1, 2), colour=3)
as_ball, ball_vector, AT = _BALL.parts, _BALL.vector, _BALL.at
as_track, track_vector = _TRACK.parts, _TRACK.vector


@compiled
def again(vector):
    return ball_vector(as_ball(vector[:8])), track_vector(as_track(vector))


@compiled
def spins(vector):
    ball = as_ball(vector)
    vector[AT.centre] = 7.0
    return ball.radius + vector[AT.radius], ball.centre, ball.spin


def test_parts_are_views_of_the_vector():
    vector = np.arange(8.0)
    ball = as_ball(vector)
    assert (_BALL.size, ball.radius, ball.centre.tolist()) == (8, 0.0, [1.0, 2.0, 3.0])
    assert ball.spin.tolist() == [[4.0, 5.0], [6.0, 7.0]]
    ball.centre[:] = 9.0
    assert vector[AT.centre].tolist() == [9.0, 9.0, 9.0]


def test_a_field_of_any_length_takes_what_is_left():
    track = as_track(np.arange(11.0))
    assert track.points.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert (track.time, track.colour.tolist(), track.width) == (0.0, [7.0, 8.0, 9.0], 10.0)
    assert _TRACK.size == 5


def test_a_vector_comes_back_in_machine_code_too():
    vector = np.arange(9.0)
    np.testing.assert_array_equal(track_vector(as_track(vector)), vector)
    ball, track = again(vector)
    np.testing.assert_array_equal(ball, vector[:8])
    np.testing.assert_array_equal(track, vector)
    radius, centre, spin = spins(np.ones(8))
    assert (radius, centre.tolist(), spin.shape) == (2.0, [7.0, 7.0, 7.0], (2, 2))


def test_columns_are_vectors():
    packing = Packing(Ball, centre=3, spin=2)
    ball = packing.parts(np.arange(12.0).reshape(6, 2))
    assert ball.radius.tolist() == [0.0, 1.0]
    assert ball.centre.shape == (3, 2)


def test_a_number_fills_a_vector():
    packing = Packing(Ball, centre=3, spin=2)
    assert packing.vector(Ball(1.0, 2.0, np.arange(2))).tolist() == [1.0, *3 * [2.0], 0.0, 1.0]


def test_a_field_that_is_not_in_the_vector_is_nan():
    packing = Packing(Ball, radius=None, centre=3, spin=2)
    ball = packing.parts(np.arange(5.0))
    assert (packing.size, ball.centre[0]) == (5, 0.0)
    assert np.isnan(ball.radius)
    assert packing.vector(ball).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_no_two_packings_have_functions_of_one_name():
    """By which Numba would take the machine code of one for the other's."""
    names = [
        function.__qualname__
        for spin in (2, (2, 2), None)
        for packing in (Packing(Ball, centre=3, spin=spin),)
        for function in (packing.parts, packing.vector)
    ]
    assert len(set(names)) == 6


def test_what_is_no_field_is_an_error():
    with pytest.raises(ValueError, match="Ball has not all the fields"):
        Packing(Ball, center=3)
