import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airrace.systems.mapping.robust_estimator import RobustEstimator
from tests.systems.mapping.gate_observations import make_gate, see

ESTIMATOR = RobustEstimator(min_observations=5)
gates = st.builds(make_gate, st.floats(-80, 80), st.floats(-80, 80), st.floats(-180, 180))
seeds = st.integers(0, 1000)


def mapped(observations, tracks=None):
    """Returns the tracks and the map after observations."""
    tracks = tracks or {}
    for observation in observations:
        tracks = ESTIMATOR.updated(tracks, observation)
    return tracks, ESTIMATOR.make_map(tracks, time=1.0, detections=0, out_of_range=0, refused={})


def flight(gate, rng, ids=(0, 2), start=0.0, images=15, **kwargs):
    """Observations of some boards in each of some images."""
    return [see(gate, id, start + k / 30, rng, **kwargs) for k in range(images) for id in ids]


def worst(gate_map, gate):
    boards = gate.boards(0)
    return max(np.linalg.norm(m.p_WM - boards[m.id].X_WM.translation()) for m in gate_map.markers)


@pytest.mark.slow
@given(gates, seeds)
def test_a_known_gate_has_four_boards(gate, seed):
    """Two seen, two derived, all as good as the observations."""
    _, gate_map = mapped(flight(gate, np.random.default_rng(seed), sigma=0.02))
    assert [(m.id, m.count) for m in gate_map.markers] == [(0, 15), (1, 0), (2, 15), (3, 0)]
    assert worst(gate_map, gate) < 0.06
    (found,) = gate_map.gates
    np.testing.assert_allclose(found.p_WG, gate.p_WG, atol=0.04)
    np.testing.assert_allclose(found.forward, gate.forward, atol=0.02)
    assert found.spacing == pytest.approx(10.0, abs=0.02)
    for marker in gate_map.markers:
        normal = gate.boards(0)[marker.id].X_WM.rotation().col(2)
        np.testing.assert_allclose(marker.normal, normal, atol=0.02)
        assert np.all(marker.variance > 0)


def test_a_gate_needs_both_pylons():
    rng = np.random.default_rng(0)
    tracks, gate_map = mapped(flight(make_gate(), rng, ids=(0,)))
    assert gate_map.gates == () and [m.id for m in gate_map.markers] == [0]
    # The back board of the other pylon will do.
    _, gate_map = mapped(flight(make_gate(), rng, ids=(3,), start=1.0), tracks)
    assert [g.number for g in gate_map.gates] == [0]


@pytest.mark.parametrize("spacing", [6.0, 8.0, 10.3, 12.0])
def test_gates_that_are_not_by_the_rules(spacing):
    gate = make_gate(spacing=spacing)
    _, gate_map = mapped(flight(gate, np.random.default_rng(0), sigma=0.02))
    assert worst(gate_map, gate) < 0.06
    assert gate_map.gates[0].spacing == pytest.approx(spacing, abs=0.05)


@pytest.mark.slow
@given(gates, seeds)
def test_gross_outliers_do_no_harm(gate, seed):
    rng = np.random.default_rng(seed)
    observations, wrong = flight(gate, rng, images=40, sigma=0.02), 0
    for k in range(len(observations)):
        if rng.random() < 0.05:  # also the very first may be wrong
            error = rng.normal(0, 3, 3)
            wrong += np.linalg.norm(error) > 0.5
            observations[k] = see(gate, observations[k].id, observations[k].time, rng, error=error)
    _, gate_map = mapped(observations)
    assert worst(gate_map, gate) < 0.08
    refused = sum(gate_map.refused.values())
    assert wrong <= refused <= wrong + 0.02 * len(observations) + 12
    assert sum(m.count for m in gate_map.markers) + refused == len(observations)


@pytest.mark.slow
@given(gates, seeds, st.floats(0.5, 15.0), st.floats(-np.pi, np.pi), st.floats(-60, 60))
def test_a_gate_that_moved_is_followed(gate, seed, distance, direction, turn):
    rng = np.random.default_rng(seed)
    tracks, before = mapped(flight(gate, rng, images=40, sigma=0.02))
    x, y = gate.p_WG[:2] + distance * np.array([np.cos(direction), np.sin(direction)])
    moved = make_gate(x, y, gate.heading_deg + turn)
    _, after = mapped(flight(moved, rng, start=30.0, images=10, sigma=0.02), tracks)
    assert worst(after, moved) < 0.1
    assert [g.number for g in after.gates] == [0]  # and it was never lost
    for marker in after.markers[::2]:
        assert marker.count >= 40


def test_two_in_agreement_beat_the_old_estimate():
    rng = np.random.default_rng(0)
    tracks, _ = mapped(flight(make_gate(), rng, images=300))
    moved = make_gate(x=22.0)
    tracks, still = mapped([see(moved, 0, 30.0, rng)], tracks)
    assert still.gates[0].p_WG[0] == pytest.approx(20.0, abs=0.05)
    assert still.refused == {"far from the map": 1}
    _, after = mapped([see(moved, 0, 30.1, rng)], tracks)
    assert after.gates[0].p_WG[0] == pytest.approx(22.0, abs=0.4)
    assert after.refused == {}


def test_two_wrong_ones_of_one_image_do_not_beat_it():
    """A wrong pose of the drone moves all that it sees alike."""
    rng = np.random.default_rng(0)
    tracks, _ = mapped(flight(make_gate(), rng))
    shifted = [see(make_gate(y=8.0), id, 1.0, rng) for id in (0, 2)]
    _, after = mapped([*shifted, *flight(make_gate(), rng, start=1.1)], tracks)
    assert worst(after, make_gate()) < 0.1
    assert after.refused == {"far from the map": 2}


def test_why_an_observation_does_not_fit():
    rng = np.random.default_rng(0)
    tracks, _ = mapped([see(make_gate(), 0, 0.0, rng)])
    assert mapped([], tracks)[1].refused == {"not yet confirmed": 1}
    tracks, _ = mapped(flight(make_gate(), rng, start=0.1))
    for time, reason in ((0.6, "pose jumps"), (5.0, "far from the map")):
        _, gate_map = mapped([see(make_gate(x=25.0), 2, time, rng)], tracks)
        assert gate_map.refused == {reason: 1}
        assert {m.id: m.outliers for m in gate_map.markers} == {0: 0, 1: 0, 2: 1, 3: 0}


@pytest.mark.parametrize("id, x", [(0, 24.0), (2, 30.0), (1, 16.0), (3, 10.0)])
def test_a_face_seen_from_behind(id, x):
    """However often, and even where the map has it."""
    rng = np.random.default_rng(0)
    gate = make_gate()
    tracks, before = mapped(flight(gate, rng))
    _, after = mapped(flight(gate, rng, ids=(id,), start=1.0, p_WC=[x, 5.0, 6.0]), tracks)
    assert after.refused == {"seen from behind": 15}
    np.testing.assert_array_equal(after.gates[0].p_WG, before.gates[0].p_WG)


def test_consecutive_frames_are_not_independent():
    rng = np.random.default_rng(0)
    sparse = flight(make_gate(), rng, images=1)
    dense = flight(make_gate(), rng, images=10)
    long = [see(make_gate(), id, 1.0 * k, rng) for k in range(10) for id in (0, 2)]
    a, b, c = (
        mapped([*flight(make_gate(), rng, start=-9.0, images=2), *observations])[1].markers[0]
        for observations in (sparse, dense, long)
    )
    assert c.variance[0] < b.variance[0] < a.variance[0]
    assert b.variance[0] > 2 * c.variance[0]


@pytest.mark.slow
def test_tracks_do_not_grow():
    rng = np.random.default_rng(0)
    tracks, _ = mapped(flight(make_gate(), rng))
    scattered = [
        see(make_gate(), id, 2.0 + k, rng, error=rng.normal(0, 30, 3))
        for k in range(200)
        for id in (0, 2)
    ]
    tracks, gate_map = mapped(scattered, tracks)
    assert len(tracks[0].unconfirmed) <= 8
    assert len(tracks[0].refused) <= 4 * 4
    assert sum(gate_map.refused.values()) + sum(m.count for m in gate_map.markers) == 430


def test_a_gate_that_moved_stays_in_the_map():
    """Two observations in agreement from afar: not good enough for a new gate, but for a known one."""
    rng = np.random.default_rng(4)
    gate, moved = make_gate(), make_gate(x=26.0)
    from_afar = [see(moved, id, 30.0 + 0.5 * id, rng, sigma=0.6) for id in (0, 2)]
    tracks, gate_map = mapped(flight(gate, rng, sigma=0.02))
    assert len(gate_map.gates) == 1
    tracks, gate_map = mapped(from_afar, tracks)
    (found,) = gate_map.gates
    assert np.linalg.norm(found.p_WG - moved.p_WG) < 2.0
    assert np.linalg.eigvalsh(tracks[0].estimate.covariance[:3, :3])[-1] > 0.3**2
    assert len(gate_map.markers) == 4
    # Another move does not lose it, either.
    again = [see(gate, id, 60.0 + 0.5 * id, rng, sigma=0.6) for id in (0, 2)]
    _, gate_map = mapped(again, tracks)
    assert np.linalg.norm(gate_map.gates[0].p_WG - gate.p_WG) < 2.0
    # A gate that was never known well needs more than that.
    _, gate_map = mapped(from_afar * 3)
    assert gate_map.gates == ()
