import re

import pytest
import yaml

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml
from airrace.track import load_track
from airrace.track.square_track import SquareTrack


def written(tmp_path, name, change=lambda data: None):
    """Writes a shipped track with a change to its plain data."""
    data = yaml.safe_load(find_yaml("tracks", name).read_text())
    change(data)
    path = tmp_path / "track.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def test_any_kind_of_track_is_loaded(tmp_path):
    course = load_track("grand-prix")
    assert isinstance(course, SquareTrack) and len(course.gates) == 17
    assert load_track(written(tmp_path, "grand-prix")) == course
    assert load_track("hexagon") == load_track("hexagon", markers=True)


def test_who_looks_for_markers_is_told_where_there_are_none():
    with pytest.raises(UserError, match="airrace grand-prix --track grand-prix"):
        load_track("grand-prix", markers=True)


@pytest.mark.parametrize("gate", [{"kind": "round"}, {"kind": "pylons"}, {}, "square", 3, [1]])
def test_other_kinds_of_gates_are_refused(tmp_path, gate):
    path = written(tmp_path, "grand-prix", lambda data: data.update(gate=gate))
    with pytest.raises(UserError, match=re.escape("write gate: {kind: square}, or leave gate")):
        load_track(path)


def test_missing_and_malformed_files(tmp_path):
    with pytest.raises(UserError, match="student-airrace"):
        load_track("no-such-track")
    with pytest.raises(UserError, match="no such file"):
        load_track(str(tmp_path / "none.yaml"))
    broken = tmp_path / "broken.yaml"
    broken.write_text("gates: [1, 2")
    with pytest.raises(UserError, match="not valid YAML at line"):
        load_track(str(broken))
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="not a text file|not valid YAML"):
        load_track(str(broken))
    broken.write_text("just a sentence")
    with pytest.raises(UserError, match="does not fit"):
        load_track(str(broken))


def test_a_changed_file_is_read_again(tmp_path):
    path = written(tmp_path, "student-airrace")
    assert len(load_track(path).gates) == 10
    written(tmp_path, "student-airrace", lambda data: data["gates"].pop())
    assert len(load_track(path).gates) == 9
