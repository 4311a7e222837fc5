import numpy as np

from airrace.track import load_track
from airrace.track.layout import Layout


def test_layout_of_the_reference_track():
    track = load_track("student-airrace")
    layout = Layout.of(track)
    np.testing.assert_allclose(layout.pylons.reshape(-1, 2), track.pylons()[:, :2], atol=1e-9)
    np.testing.assert_allclose(layout.middle, [gate.p_WG[:2] for gate in track.gates])
    np.testing.assert_allclose(np.rad2deg(layout.turns), [45] * 9 + [-45])
    root = np.sqrt(2)
    np.testing.assert_allclose(
        layout.lengths, [20, 15 * root, 20, 25 * root, 70, 30 * root, 30, 30 * root, 30, 30 * root]
    )


def test_straight_on_leads_through_the_next_gate():
    """Where the way straight on ends is ahead, and between the next two pylons."""
    layout = Layout.of(load_track("student-airrace"))
    for i, end in enumerate(layout.straight_ends):
        following = (i + 1) % len(layout.left)
        ahead = end - layout.middle[i]
        np.testing.assert_allclose(ahead / np.linalg.norm(ahead), layout.forward[i], atol=1e-9)
        right, left = layout.right[following], layout.left[following]
        share = np.linalg.norm(end - left) / np.linalg.norm(right - left)
        np.testing.assert_allclose(left + share * (right - left), end, atol=1e-9)
        assert 0.3 < share < 0.8
