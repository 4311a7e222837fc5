import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.immutable import read_only
from airrace.math.angles import wrap_angle
from airrace.systems.mapping import gate_filter as gf
from tests.systems.mapping.gate_observations import SIGMA, make_gate, see

states = st.tuples(
    st.floats(-80, 80), st.floats(-80, 80), st.floats(2, 10), st.floats(-4, 4), st.floats(5, 15)
).map(np.array)
gates = st.builds(make_gate, st.floats(-80, 80), st.floats(-80, 80), st.floats(-180, 180))
seeds = st.integers(0, 1000)


def state_of(gate):
    return np.array([*gate.p_WG, gate.heading, gate.pylon_spacing])


def error(estimate, gate):
    difference = estimate.state - state_of(gate)
    difference[3] = wrap_angle(difference[3])
    return difference


@given(gates, st.integers(0, 3))
def test_boards_are_where_the_track_has_them(gate, id):
    p_WM, _ = gf.board_position(state_of(gate), id)
    np.testing.assert_allclose(p_WM, gate.boards(0)[id].X_WM.translation(), atol=1e-9)
    out = gf.facing(id) * gate.forward
    np.testing.assert_allclose(out, gate.boards(0)[id].X_WM.rotation().col(2), atol=1e-12)


@given(states, st.integers(0, 3))
def test_the_derivative_of_a_boards_position(state, id):
    _, J = gf.board_position(state, id)
    numerical = np.column_stack(
        [
            (gf.board_position(state + h, id)[0] - gf.board_position(state - h, id)[0]) / 2e-6
            for h in 1e-6 * np.eye(5)
        ]
    )
    np.testing.assert_allclose(J, numerical, atol=1e-6)


@given(gates, seeds)
def test_a_fit_is_as_good_as_it_says(gate, seed):
    rng = np.random.default_rng(seed)
    estimate = gf.fit([see(gate, id, 0.1 * id, rng) for id in (0, 2, 1, 3)])
    off = error(estimate, gate)
    assert off @ np.linalg.solve(estimate.covariance, off) < 30.0  # chi-square of five
    assert np.all(np.linalg.eigvalsh(estimate.covariance) > 0)


@pytest.mark.slow
@given(gates, seeds)
def test_errors_shrink_with_observations(gate, seed):
    rng = np.random.default_rng(seed)
    estimate = gf.fit([see(gate, 0, 0.0, rng), see(gate, 2, 0.1, rng)])
    trace = np.trace(estimate.covariance)
    for k in range(2, 60):
        estimate = estimate.updated(see(gate, k % 4, 0.1 * k, rng), 1.0)
    assert np.trace(estimate.covariance) < trace / 10
    assert np.linalg.norm(error(estimate, gate)[:3]) < 4 * SIGMA / np.sqrt(60 / 3)


@pytest.mark.slow
@given(gates, seeds)
def test_one_board_improves_all_four(gate, seed):
    rng = np.random.default_rng(seed)
    estimate = gf.fit([see(gate, 0, 0.0, rng), see(gate, 2, 0.1, rng)])
    after = estimate
    for k in range(20):
        after = after.updated(see(gate, 0, 0.2 + 0.1 * k, rng), 1.0)
    for id in range(4):
        before, now = (gf.boards(b.state, b.covariance)[id, 1].sum() for b in (estimate, after))
        assert now < before


@pytest.mark.slow
@given(gates, seeds, st.floats(-np.pi, np.pi), st.tuples(*[st.floats(-50, 50)] * 2))
def test_turning_the_world_turns_the_estimate(gate, seed, turn, shift):
    """Equivariance: the same observations in another world frame are the same gate there."""
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    t = np.array([*shift, 0.0])

    def moved(observation):
        return observation._replace(
            p_WC=read_only(R @ observation.p_WC + t),
            p_WM=read_only(R @ observation.p_WM + t),
            covariance=read_only(R @ observation.covariance @ R.T),
            normal=read_only(R @ observation.normal),
        )

    rng = np.random.default_rng(seed)
    observations = [see(gate, k % 3, 0.1 * k, rng) for k in range(8)]

    def filtered(observations):
        estimate = gf.fit(observations[:2])
        for observation in observations[2:]:
            estimate = estimate.updated(observation, 0.5)
        return estimate

    here, there = filtered(observations), filtered([moved(s) for s in observations])
    np.testing.assert_allclose(R @ here.state[:3] + t, there.state[:3], atol=1e-6)
    assert wrap_angle(here.heading + turn - there.heading) == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(
        R @ here.covariance[:3, :3] @ R.T, there.covariance[:3, :3], atol=1e-8
    )


@pytest.mark.parametrize(
    "spacing, obeys_rules", [(10.0, True), (10.1, True), (10.4, False), (8.0, False)]
)
def test_only_gates_that_look_so_are_by_the_rules(spacing, obeys_rules):
    rng = np.random.default_rng(0)
    gate = make_gate(spacing=spacing)
    estimate = gf.fit([see(gate, 0, 0.0, rng), see(gate, 2, 0.1, rng)])
    for k in range(20):
        estimate = estimate.updated(see(gate, 2 * (k % 2), 0.2 + 0.1 * k, rng), 1.0)
    after = estimate.with_rules()
    assert after.obeys_rules == obeys_rules
    assert after.with_rules() is after
    if obeys_rules:
        assert abs(after.spacing - 10.0) < abs(estimate.spacing - 10.0) + 1e-9
    else:
        assert after is estimate
        assert estimate.spacing == pytest.approx(spacing, abs=0.1)


def test_a_gate_that_moves_is_still_as_wide():
    rng = np.random.default_rng(0)
    estimate = gf.fit(
        [see(make_gate(), id, 0.1 * k, rng, sigma=0.01) for k, id in enumerate((0, 2, 0, 2))]
    )
    known = estimate.with_rules()
    assert known.obeys_rules
    pair = [see(make_gate(x=25.0), 0, time, rng) for time in (1.0, 1.1)]
    moved = gf.fit_pair(*pair, known)
    assert moved.obeys_rules
    assert moved.spacing == pytest.approx(10.0, abs=0.02)
    assert moved.covariance[4, 4] < 0.02**2
    assert gf.fit_pair(*pair, estimate).covariance[4, 4] > 0.5


def test_a_spacing_that_is_not_known_yet_is_left_alone():
    estimate = gf.fit([see(make_gate(), 0, 0.0, np.random.default_rng(0))])
    assert estimate.with_rules() is estimate


def test_agreement():
    gate, rng = make_gate(), np.random.default_rng(0)
    first = see(gate, 0, 0.0, rng)
    assert gf.fit_pair(first, see(gate, 0, 0.1, rng)) is not None
    assert gf.fit_pair(first, see(gate, 2, 0.1, rng)) is not None
    assert gf.fit_pair(first, see(gate, 0, 0.0, rng)) is None  # of the same image
    assert gf.fit_pair(first, see(gate, 0, 0.1, rng, error=[0, 1.0, 0])) is None
    assert gf.fit_pair(first, see(make_gate(heading_deg=40.0), 2, 0.1, rng)) is None


@given(gates, seeds)
def test_contradictory_normals_are_no_trouble(gate, seed):
    rng = np.random.default_rng(seed)
    a = see(gate, 0, 0.0, rng)
    b = a._replace(time=0.1, normal=read_only(-a.normal))
    assert np.isfinite(gf.fit((a, b)).state).all()
    assert np.isfinite(gf.fit((a,)).updated(b, 1.0).state).all()
