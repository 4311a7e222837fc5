import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import BodyIndex

from airrace.systems.plant.drag import Drag
from airrace.vehicle import Drag as Coefficients
from airrace.vehicle import load_vehicle

COEFFICIENTS = Coefficients(
    linear=[0.1, 0.2, 0.3], quadratic=[0.01, 0.02, 0.03], angular=[0.001, 0.002, 0.003]
)
VEHICLE = dc.replace(load_vehicle("Default")[0], drag=COEFFICIENTS)


def drag(q=(1, 0, 0, 0), w=(0, 0, 0), v=(0, 0, 0), wind=(0, 0, 0), p=(0, 0, 0), share=1.0):
    """Returns the moment and the force in the world."""
    system = Drag(vehicle=VEHICLE, share=share, body_index=BodyIndex(7))
    context = system.CreateDefaultContext()
    system.GetInputPort("state").FixValue(context, np.concatenate([q, p, w, v]).astype(float))
    system.GetInputPort("wind").FixValue(context, np.array(wind, float))
    (force,) = system.GetOutputPort("spatial_forces").Eval(context)
    assert force.body_index == BodyIndex(7)
    np.testing.assert_array_equal(force.p_BoBq_B, 0.0)
    return force.F_Bq_W.rotational(), force.F_Bq_W.translational()


def vectors(size):
    return st.tuples(*[st.floats(-size, size)] * 3).map(np.array)


quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1)
)


@pytest.mark.slow
def test_along_the_axes():
    moment, force = drag(v=[3.0, 0.0, -4.0], w=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(force, [-3 * (0.1 + 5 * 0.01), 0, 4 * (0.3 + 5 * 0.03)])
    np.testing.assert_allclose(moment, [-0.001, -0.004, -0.009])


def test_in_the_axes_of_the_body():
    """Turned left by 90 degrees, flight along the world's x is flight along -y."""
    q = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    moment, force = drag(q, v=[5.0, 0, 0], w=[1.0, 0, 0])
    np.testing.assert_allclose(force, [-5 * (0.2 + 5 * 0.02), 0, 0], atol=1e-12)
    np.testing.assert_allclose(moment, [-0.002, 0, 0], atol=1e-12)


@given(quaternions, vectors(10), vectors(30), vectors(30))
def test_against_matrices(q, w, v, wind):
    R = RotationMatrix(Quaternion(q / np.linalg.norm(q))).matrix()
    relative = v - wind
    c = COEFFICIENTS
    damping = np.diag(np.add(c.linear, np.multiply(c.quadratic, np.linalg.norm(relative))))
    moment, force = drag(q, w, v, wind)
    np.testing.assert_allclose(force, -R @ damping @ R.T @ relative, atol=1e-9)
    np.testing.assert_allclose(moment, -R @ np.diag(c.angular) @ R.T @ w, atol=1e-12)


@given(quaternions, vectors(10), vectors(30), vectors(30))
def test_it_only_ever_brakes(q, w, v, wind):
    moment, force = drag(q, w, v, wind)
    assert force @ (v - wind) <= 0.0
    assert moment @ w <= 0.0


@given(quaternions, quaternions, vectors(10), vectors(30), vectors(30))
def test_it_turns_with_the_world(q, turn, w, v, wind):
    turn = Quaternion(turn / np.linalg.norm(turn))
    R = turn.rotation()
    turned_q = turn.multiply(Quaternion(q / np.linalg.norm(q))).wxyz()
    moment, force = drag(q, w, v, wind)
    turned_moment, turned_force = drag(turned_q, R @ w, R @ v, R @ wind)
    np.testing.assert_allclose(turned_force, R @ force, atol=1e-9)
    np.testing.assert_allclose(turned_moment, R @ moment, atol=1e-12)


@pytest.mark.slow
@given(vectors(30), vectors(30), vectors(100))
def test_only_the_velocity_through_the_air_counts(v, wind, p):
    _, force = drag(v=v, wind=wind)
    _, moved = drag(v=v - wind, p=p)
    np.testing.assert_allclose(force, moved, atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.5, 2.0])
def test_share(share):
    whole = drag(v=[1, 2, 3], w=[3, 2, 1])
    np.testing.assert_allclose(
        drag(v=[1, 2, 3], w=[3, 2, 1], share=share), share * np.array(whole), rtol=1e-12
    )
