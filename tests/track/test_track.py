import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.track import Gate, load_track

REFERENCE = models_path() / "tracks" / "student-airrace.yaml"


def write_track(tmp_path, change):
    """Writes the track student-airrace with a change to its plain data."""
    data = yaml.safe_load(REFERENCE.read_text())
    change(data)
    path = tmp_path / "track.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def test_reference_track():
    track = load_track("student-airrace")
    middles = np.array([gate.p_WG for gate in track.gates])
    length = np.linalg.norm(np.roll(middles, -1, axis=0) - middles, axis=1).sum()
    assert len(track.gates) == 10
    assert length == pytest.approx(382.4, abs=0.1)
    assert [board.id for board in track.boards()] == list(range(40))


@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(-720, 720), st.floats(4.5, 20))
def test_boards_stand_as_on_the_drawing(x, y, heading_deg, spacing):
    gate = Gate([x, y], heading_deg, spacing)
    boards = gate.boards(3)
    assert [board.id for board in boards] == [12, 13, 14, 15]
    feet = [gate.p_WL, gate.p_WL, gate.p_WR, gate.p_WR]
    for board, foot in zip(boards, feet):
        out = board.X_WM.rotation().col(2)
        towards_drone = -1 if board.id % 2 == 0 else 1
        np.testing.assert_allclose(out, towards_drone * gate.forward, atol=1e-12)
        np.testing.assert_allclose(board.X_WM.rotation().col(1), [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(board.X_WM.translation() - foot, out + [0, 0, 6.25], atol=1e-9)
    assert np.linalg.norm(gate.p_WR - gate.p_WL) == pytest.approx(spacing)
    # The left pylon is on the left of a pilot flying through.
    assert np.cross(gate.forward, gate.p_WL - gate.p_WR)[2] > 0


BAD = {
    "two gates": (lambda d: d["gates"].__delitem__(slice(2, None)), "at least 3 gates"),
    "NaN": (lambda d: d["gates"][4].update(heading_deg=math.nan), "gate 5"),
    "infinite": (lambda d: d["gates"][0].update(left_pylon=[math.inf, 0.0]), "gate 1"),
    "three numbers": (lambda d: d["gates"][0].update(left_pylon=[1.0, 2.0, 3.0]), "two numbers"),
    "no heading": (lambda d: d["gates"][3].pop("heading_deg"), "gate 4"),
    "pylons together": (lambda d: d["gates"][1].update(pylon_spacing=1.0), "pylons of gate 2"),
    "overlap": (
        lambda d: d["gates"][3].update(left_pylon=[53.0, 20.0], heading_deg=90.0),
        "gates 3 and 4 overlap",
    ),
    "crossing": (lambda d: d["gates"].insert(3, d["gates"].pop(6)), "crosses itself"),
    "in a row": (
        lambda d: d.update(
            gates=[{"left_pylon": [x, 5.0], "heading_deg": 0.0} for x in (0, 25, 50)]
        ),
        "the leg from gate 3 to gate 1 leads straight back through one of them: turn by less than 150",
    ),
    "coordinates of UTM": (
        lambda d: [
            gate["left_pylon"].__setitem__(0, gate["left_pylon"][0] + 1e6) for gate in d["gates"]
        ],
        "it reaches 10000.. m from the origin, and 1500 m is the most",
    ),
    "a start far away": (lambda d: d["start"].update(position=[0.0, -2e4, 0.0]), "reaches 20000 m"),
    "start in a pylon": (
        lambda d: d["start"].update(position=[20.0, 4.0, 0.0]),
        "start is too close",
    ),
    "start below ground": (
        lambda d: d["start"].update(position=[0.0, 0.0, -1.0]),
        "below the ground",
    ),
    "steep pad": (lambda d: d["start"].update(pad_tilt_deg=16.0), "pad_tilt_deg must lie"),
    "pad tilts nowhere": (
        lambda d: d["start"].update(pad_tilt_direction_deg=math.inf),
        "pad_tilt_direction_deg",
    ),
    "no start": (lambda d: d.pop("start"), "start.position"),
    "no name": (lambda d: d.pop("name"), "name"),
    "hover too high": (lambda d: d.update(hover_height=50.0), "hover_height"),
    "unknown key": (lambda d: d.update(colour="red"), "colour"),
}


@pytest.mark.parametrize("change, words", BAD.values(), ids=BAD.keys())
def test_bad_tracks_are_refused_with_the_reason(tmp_path, change, words):
    path = write_track(tmp_path, change)
    with pytest.raises(UserError, match=words) as e:
        load_track(path)
    assert path in str(e.value)
    assert "\n" not in str(e.value)


_points = st.tuples(st.floats(-10, 10), st.floats(-10, 10))


@given(st.lists(_points, min_size=10, max_size=10))
def test_gates_move_as_a_whole(shifts):
    track = load_track("student-airrace")
    moved = track.shifted(shifts)
    assert track == load_track("student-airrace")  # untouched
    for gate, there, (x, y) in zip(track.gates, moved.gates, shifts):
        for name in ("p_WL", "p_WR", "p_WG"):
            expected = getattr(gate, name) + [x, y, 0.0]
            np.testing.assert_allclose(getattr(there, name), expected, atol=1e-9)
        np.testing.assert_array_equal(there.forward, gate.forward)
    assert moved == track.shifted(np.ravel(shifts))
    with pytest.raises(ValueError):
        track.shifted(shifts[1:])
