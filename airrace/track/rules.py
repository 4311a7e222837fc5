"""The rules for tracks: the layout rule, room to fly, gates that can be found."""

import numpy as np

from airrace.math.angles import wrap_angle
from airrace.track.geometry import directions, point_distances, segment_distances
from airrace.track.layout import Layout
from airrace.track.track import BOARD_OFFSET, BOARD_SIZE, MARKER_SIZE, Track

GATE_COUNTS = range(8, 21, 2)  # 45-degree turns add up to 360 for no others from 8 to 20
TURN = np.pi / 4
LENGTHS = (12.0, 70.0)  # m, of a leg along the line of its left pylons
LARGEST_EXTENT = 300.0  # m, between any two pylons

# Room, from pylon axes (m). A pylon's foot is 1.7 m thick; the rest is for a
# curved path and a drone.
PYLON_TO_PYLON = 8.0  # of another gate
PYLON_TO_LEG = 6.0  # of other gates
LEG_TO_LEG = 10.0  # unless they meet at a gate

# A realistic camera at rest reads a marker in almost every picture, as measured, from 28 m
# at up to 65 degrees off its normal, from 16 m at 70 degrees, but not at 75.
FARTHEST_VIEW = 28.0  # m, to the board's centre
MOST_OBLIQUE = np.deg2rad(65.0)
HALF_VIEW = np.deg2rad(40.0)  # to either side; the picture's edge is at 43.4 degrees
SHORTEST_VIEW = 1.0  # m of the line straight on, from which the next gate is in view
_VIEW_STEP = 0.5  # m
# A pylon and its boards fit into an upright cylinder; that is what hides markers.
_HIDING_RADIUS = np.hypot(BOARD_OFFSET, BOARD_SIZE / 2)

START_TURN = np.deg2rad(30.0)  # from the start's heading to gate 1, at most
_TOLERANCE = 2e-3  # m, or rad: a file holds millimetres


class RuleError(ValueError):
    """A track breaks a rule.

    Attributes:
        rule: "layout", "closure", "extent", "clearance", "visibility" or "start".
    """

    def __init__(self, rule: str, reason: str):
        """Args: rule: see above. reason: a clause that says where and by how much."""
        super().__init__(reason)
        self.rule = rule


def check_rules(track: Track) -> None:
    """Raises RuleError for the first rule of this file that the track breaks."""
    layout = Layout.of(track)
    check_layout(layout)
    check_clearances(layout)
    check_visibility(layout)
    check_start(track, layout)


def check_layout(layout: Layout) -> None:
    """Checks the layout rule of the Student AirRace paper, section II, and closure.

    The next left pylon is straight ahead of the left pylon, the next heading
    45 degrees to the left or right, and the turns add up to one round.
    Raises RuleError: "layout", "closure" or "extent".
    """
    _check(
        "layout",
        np.abs(np.abs(layout.turns) - TURN) <= _TOLERANCE,
        "the turn after gate {} is {:.2f} degrees, not 45",
        np.rad2deg(layout.turns),
    )
    ahead = np.roll(layout.left, -1, axis=0) - layout.left
    aside = np.abs(np.sum(ahead * layout.rightward, axis=1))
    _check(
        "layout",
        aside <= _TOLERANCE,
        "the left pylon after gate {} is {:.3f} m off the line straight ahead of that gate's",
        aside,
    )
    low, high = LENGTHS[0] - _TOLERANCE, LENGTHS[1] + _TOLERANCE
    _check(
        "layout",
        (layout.lengths >= low) & (layout.lengths <= high),
        f"the leg after gate {{}} is {{:.2f}} m long, not {LENGTHS[0]:.0f} to {LENGTHS[1]:.0f}",
        layout.lengths,
    )
    total = np.rad2deg(np.sum(layout.turns))
    reason = f"its turns add up to {total:.0f} degrees, not 360"
    require_rule("closure", abs(abs(total) - 360.0) <= 1.0, reason)
    pylons = layout.pylons.reshape(-1, 2)
    extent = np.linalg.norm(pylons[:, None] - pylons, axis=2).max()
    reason = f"it is {extent:.0f} m across, not {LARGEST_EXTENT:.0f} at most"
    require_rule("extent", extent <= LARGEST_EXTENT, reason)


def check_clearances(layout: Layout) -> None:
    """Checks the room between pylons and legs.

    A leg here is the line from midpoint to midpoint, and also the line straight on from a
    midpoint to the next gate, along which an explorer searches for that gate. A line
    through a wrong gate comes near its pylons, so it is refused as well.
    Raises RuleError: "clearance".
    """
    n = len(layout.left)
    steps = (np.arange(n) - np.arange(n)[:, None]) % n  # from gate i on to gate j
    following = np.roll(layout.middle, -1, axis=0)
    pylons = layout.pylons.reshape(-1, 2)
    apart = np.linalg.norm(pylons[:, None] - pylons, axis=2)
    apart = apart.reshape(n, 2, n, 2).min(axis=(1, 3))
    _check_room("pylons of gates {} and {} are {:.1f} m apart", apart, PYLON_TO_PYLON, steps == 0)
    starts = layout.middle[:, None, None]
    to_leg = np.minimum(
        point_distances(layout.pylons, starts, following[:, None, None]),
        point_distances(layout.pylons, starts, layout.straight_ends[:, None, None]),
    )
    _check_room(
        "leg {} passes a pylon of gate {} at {:.1f} m", to_leg.min(axis=2), PYLON_TO_LEG, steps <= 1
    )
    between = segment_distances(layout.middle, following)
    meet = (steps <= 1) | (steps == n - 1)
    _check_room("legs {} and {} come within {:.1f} m", between, LEG_TO_LEG, meet)


def check_visibility(layout: Layout) -> None:
    """Checks that a flight straight on from each gate finds the next one.

    From some part of the line straight on from each gate's midpoint, with the camera
    forward at the height of the boards, both front markers of the next gate
    are in view, near and square enough to be read, and not hidden.
    Raises RuleError: "visibility".
    """
    n = len(layout.left)
    for i in range(n):
        following = (i + 1) % n
        length = np.linalg.norm(layout.straight_ends[i] - layout.middle[i])
        along = np.arange(0.0, length, _VIEW_STEP)
        viewpoints = layout.middle[i] + along[:, None] * layout.forward[i]
        seen = gate_in_view(layout, following, viewpoints, layout.headings[i])
        reason = f"gate {following + 1} cannot be seen on the way straight on from gate {i + 1}"
        enough = (_longest_run(seen) - 1) * _VIEW_STEP >= SHORTEST_VIEW
        require_rule("visibility", enough, reason)


def check_start(track: Track, layout: Layout) -> None:
    """Raises RuleError, "start", unless gate 1 is ahead of it, near, in view and free to fly to."""
    start = np.array(track.start.position[:2])
    to_gate = layout.middle[0] - start
    bearing = np.arctan2(to_gate[1], to_gate[0])
    turn = abs(wrap_angle(bearing - np.deg2rad(track.start.heading_deg)))
    _require_start(to_gate @ layout.forward[0] > 0, "it is beyond gate 1")
    _require_start(
        turn <= START_TURN + _TOLERANCE, f"gate 1 is {np.rad2deg(turn):.1f} degrees off its heading"
    )
    _require_start(
        gate_in_view(layout, 0, start[None], bearing)[0],
        "the markers of gate 1 cannot be seen from it",
    )
    near = np.linalg.norm(layout.pylons - start, axis=2).min()
    _require_start(near >= PYLON_TO_LEG, f"a pylon is {near:.1f} m from it")
    near = point_distances(layout.pylons[1:], start, layout.middle[0]).min()
    _require_start(near >= PYLON_TO_LEG, f"on the way to gate 1 a pylon is {near:.1f} m away")
    # The first and the last leg meet at gate 1, where the start may be near.
    near = point_distances(start, layout.middle[1:-1], layout.middle[2:]).min()
    _require_start(near >= LEG_TO_LEG, f"a leg passes it at {near:.1f} m")


def gate_in_view(layout: Layout, gate: int, viewpoints: np.ndarray, heading: float) -> np.ndarray:
    """Returns from which points both front markers of a gate can be read, (k,) bool.

    Args:
        gate: its number, from 0.
        viewpoints: (k, 2) m; the camera is at the height of the boards there.
        heading: of the camera (rad).
    """
    forward, rightward = layout.forward[gate], layout.rightward[gate]
    centres = layout.pylons[gate] - BOARD_OFFSET * forward  # (2 boards, 2)
    ray = centres - viewpoints[:, None]  # (k, 2 boards, 2)
    distance = np.linalg.norm(ray, axis=2)
    near = (distance <= FARTHEST_VIEW) & (ray @ forward >= np.cos(MOST_OBLIQUE) * distance)
    edges = centres[:, None] + MARKER_SIZE / 2 * np.array([-rightward, rightward])
    ray = edges - viewpoints[:, None, None]  # (k, 2 boards, 2 edges, 2)
    inside = ray @ directions(heading) >= np.cos(HALF_VIEW) * np.linalg.norm(ray, axis=3)
    seen = np.all(near, axis=1) & np.all(inside, axis=(1, 2))
    # A board's own pylon is behind it.
    pylons = layout.pylons.reshape(-1, 2)
    for board in range(2):
        others = np.delete(pylons, 2 * gate + board, axis=0)
        p = viewpoints[seen, None, None]
        gaps = point_distances(others[:, None], p, edges[board])  # (seen, others, 2 edges)
        seen[seen] = np.all(gaps > _HIDING_RADIUS, axis=(1, 2))
    return seen


def _longest_run(flags: np.ndarray) -> int:
    """Returns the length of the longest run of True."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags, [0]])))
    return int(max(ends[1::2] - ends[::2], default=0))


def _check(rule, good, reason, values):
    """Requires something of every gate, or pair; reason takes their numbers and the value."""
    for index in np.argwhere(~good):
        raise RuleError(rule, reason.format(*(index + 1), values[tuple(index)]))


def _check_room(reason, distances, least, exempt):
    """Requires distances, (n, n) m."""
    reason += f", not {least:.0f} m or more"
    _check("clearance", (distances >= least) | exempt, reason, distances)


def require_rule(rule: str, condition: object, reason: str) -> None:
    """Raises RuleError unless a condition holds."""
    if not condition:
        raise RuleError(rule, reason)


def _require_start(condition, reason):
    require_rule("start", condition, f"the start is not fair: {reason}")
