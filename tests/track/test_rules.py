import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.track import BOARD_HEIGHT, Gate, Start, Track, load_track, rules
from airrace.track.generator import generate_track
from airrace.track.layout import Layout, directions
from airrace.track.rules import (
    RuleError,
    check_clearances,
    check_layout,
    check_rules,
    check_start,
    check_visibility,
    gate_in_view,
)
from airrace.vehicle import CameraMount
from airrace.vehicle.camera_info import make_camera_info


def octagon(length, sign):
    """Returns the layout of eight gates with equal legs."""
    headings = sign * np.deg2rad(45.0) * np.arange(8)
    left = np.concatenate([np.zeros((1, 2)), np.cumsum(length * directions(headings), axis=0)[:-1]])
    return Layout(left, headings, np.full(8, 10.0))


def moved(track, gate, **changes):
    """Returns a track with something else about one gate."""
    gates = list(track.gates)
    gates[gate] = dc.replace(gates[gate], **changes)
    return dc.replace(track, gates=gates)


REFERENCE = load_track("student-airrace")


def test_the_reference_track_keeps_all_rules():
    check_rules(REFERENCE)


def test_the_shipped_hexagon_breaks_two():
    """As its file says: it is for quick tries."""
    hexagon = Layout.of(load_track("hexagon"))
    for check, words in (
        (check_layout, "the turn after gate 1 is 60.00 degrees, not 45"),
        (check_visibility, "gate 2 cannot be seen on the way straight on from gate 1"),
    ):
        with pytest.raises(RuleError, match=words):
            check(hexagon)


@pytest.mark.parametrize("sign", [1, -1])
def test_octagons_keep_the_rules(sign):
    layout = octagon(30.0, sign)
    check_layout(layout)
    check_clearances(layout)
    check_visibility(layout)


@pytest.mark.parametrize(
    "change, words",
    [
        (dict(left_pylon=[55.0, 40.1]), "the left pylon after gate 4 is"),
        (dict(heading_deg=130.0), "the turn after gate 3 is 40.00 degrees, not 45"),
        (dict(heading_deg=90.0), "0.00 degrees, not 45"),
    ],
)
def test_the_layout_rule(change, words):
    with pytest.raises(RuleError, match=words) as e:
        check_rules(moved(REFERENCE, 3, **change))
    assert e.value.rule == "layout"


@pytest.mark.parametrize("length", [11.9, 70.1])
def test_lengths_of_legs(length):
    with pytest.raises(RuleError, match=f"leg after gate 1 is {length:.2f} m long, not 12 to 70"):
        check_layout(octagon(length, 1))


def test_turns_make_one_round():
    layout = octagon(30.0, 1)
    twice = Layout(
        *(np.concatenate([a, a]) for a in (layout.left, layout.headings, layout.spacing))
    )
    with pytest.raises(RuleError, match="add up to 720 degrees") as e:
        check_layout(twice)
    assert e.value.rule == "closure"
    with pytest.raises(RuleError, match="gates 1 and 9 are 0.0 m apart"):
        check_clearances(twice)


def test_extent():
    layout = octagon(70.0, 1)
    check_layout(layout)
    with pytest.raises(RuleError, match=r"it is \d+ m across, not 300 at most") as e:
        check_layout(dc.replace(layout, spacing=np.array([10.0, 10.0, 230.0] + [10.0] * 5)))
    assert e.value.rule == "extent"


def test_room_between_pylons():
    with pytest.raises(RuleError, match="pylons of gates 1 and 2 are 5.7 m apart, not 8") as e:
        check_clearances(octagon(12.0, -1))
    assert e.value.rule == "clearance"


def test_a_leg_keeps_away_from_other_gates():
    with pytest.raises(RuleError, match="leg 5 passes a pylon of gate 8 at 0.0 m, not 6"):
        check_clearances(Layout.of(moved(REFERENCE, 7, left_pylon=[0.0, 70.0])))


def test_a_leg_crosses_no_other(monkeypatch):
    """Also where no pylon is near."""
    monkeypatch.setattr(rules, "PYLON_TO_LEG", 0.0)
    with pytest.raises(RuleError, match="legs 5 and 7 come within 0.0 m, not 10"):
        check_clearances(Layout.of(moved(REFERENCE, 7, left_pylon=[0.0, 85.0])))


def test_a_hidden_marker():
    """A pylon right in front of the left board of gate 6 hides it from everywhere."""
    check_visibility(Layout.of(REFERENCE))
    hidden = moved(REFERENCE, 7, left_pylon=[-37.3, 66.4])
    with pytest.raises(RuleError, match="gate 6 cannot be seen .* straight on from gate 5") as e:
        check_visibility(Layout.of(hidden))
    assert e.value.rule == "visibility"


def test_a_marker_seen_too_obliquely():
    check_visibility(octagon(18.0, -1))
    with pytest.raises(RuleError, match="gate 2 cannot be seen"):
        check_visibility(octagon(16.0, -1))


START = Start(position=[0.0, 0.0, 0.0], heading_deg=0.0)


@pytest.mark.parametrize(
    "start, words",
    [
        (dict(position=[25.0, 0.0, 0.0]), "beyond gate 1"),
        (dict(heading_deg=31.0), "gate 1 is 31.0 degrees off its heading"),
        (dict(position=[-20.0, 0.0, 0.0]), "markers of gate 1 cannot be seen"),
        (dict(position=[12.0, 12.0, 0.0], heading_deg=-50.0), "markers of gate 1 cannot be seen"),
    ],
)
def test_starts(start, words):
    track = dc.replace(REFERENCE, start=dc.replace(START, **start))
    with pytest.raises(RuleError, match=words) as e:
        check_start(track, Layout.of(track))
    assert e.value.rule == "start"


@pytest.mark.parametrize(
    "left_pylon, words",
    [
        ([-5.0, 0.0], "a pylon is 5.0 m from it"),
        ([8.0, -5.5], "on the way to gate 1 a pylon is 5.5 m away"),
        ([-12.0, 30.0], "a leg passes it at 9"),
    ],
)
def test_room_about_the_start(left_pylon, words):
    track = moved(REFERENCE, 8, left_pylon=left_pylon)
    with pytest.raises(RuleError, match=words):
        check_start(track, Layout.of(track))


INFO = make_camera_info(width=1280, height=720, fov_y=np.deg2rad(55.95), X_BC=CameraMount().X_BC)


def ids_in_picture(track, point, heading):
    """Returns the IDs that a detector finds in the picture from a point."""
    X_WB = RigidTransform(RollPitchYaw(0, 0, heading), [*point, BOARD_HEIGHT])
    picture = np.zeros((INFO.height, INFO.width), np.uint8)
    PlanarRenderer(track, INFO).render(X_WB @ INFO.X_BC, picture)
    return set(MarkerSearch().everywhere(picture)[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "track",
    [REFERENCE, generate_track(1, 8, "left"), generate_track(1, 12, "right")],
    ids=lambda t: t.name,
)
def test_what_is_said_to_be_in_view_is_found_in_pictures(track):
    layout = Layout.of(track)
    for i, end in enumerate(layout.straight_ends):
        gate = (i + 1) % len(track.gates)
        ways = np.linspace(layout.middle[i], end, 60)
        seen = ways[gate_in_view(layout, gate, ways, layout.headings[i])]
        for point in (seen[0], seen[-1]):
            found = ids_in_picture(track, point, layout.headings[i])
            assert {4 * gate, 4 * gate + 2} <= found


def test_what_is_hidden_is_not_found_in_pictures():
    """A pylon between the camera and one board, or a little beside."""
    for offset, visible in ((0.0, False), (2.0, True)):
        track = Track(
            gates=[
                Gate(left_pylon=[20.0, 5.0], heading_deg=0.0),
                Gate(left_pylon=[10.0, 2.6 + offset], heading_deg=180.0),
            ]
        )
        seen = gate_in_view(Layout.of(track), 0, np.zeros((1, 2)), 0.0)
        assert seen.tolist() == [visible]
        assert (ids_in_picture(track, (0.0, 0.0), 0.0) >= {0, 2}) == visible
