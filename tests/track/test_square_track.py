import pytest
import yaml

from airrace.common.errors import UserError
from airrace.common.resources import find_yaml
from airrace.track import load_track

DATA = yaml.safe_load(find_yaml("tracks", "grand-prix").read_text())


def written(tmp_path, change=lambda data: None):
    data = yaml.safe_load(yaml.safe_dump(DATA))
    change(data)
    path = tmp_path / "course.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def set_gate(i, **values):
    return lambda data: data["gates"][i].update(values)


def set_start(**values):
    return lambda data: data["start"].update(values)


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda data: data.update(name=""), "it has no name"),
        (lambda data: data.update(surroundings="sea"), "surroundings must be hall or lawn"),
        (lambda data: data.update(gates=data["gates"][:1]), "at least 2 gates"),
        (set_start(position=[0.0, 0.0]), "start.position needs three numbers"),
        (set_start(position=[0.0, 0.0, -1.0]), "the start lies below the ground"),
        (set_start(heading_deg=float("nan")), "all finite"),
        (set_start(pad_tilt_deg=26.0), "pad_tilt_deg must lie between 0 and 25"),
        (set_start(position=[-9.0, 2.7, 0.5]), "the start is too close to gate 1"),
        (set_gate(2, position=[1.0]), "position of gate 3 needs three numbers"),
        (set_gate(2, yaw_deg=float("inf")), "a number of gate 3 is missing or not finite"),
        (lambda data: data["gates"][2].pop("yaw_deg"), "a number of gate 3 is missing"),
        (set_gate(2, pitch_deg=61.0), "pitch_deg of gate 3 must lie between -60 and 60"),
        (set_gate(2, position=[0.0, 20.0, 1.3]), "the frame of gate 3 sticks in the ground"),
        (set_gate(2, position=DATA["gates"][3]["position"]), "gates 3 and 4 overlap"),
        (set_gate(2, left_pylon=[1.0, 2.0]), "does not fit its schema: .*left_pylon is unknown"),
        (lambda data: data["gate"].update(size=2), "does not fit its schema: .*size is unknown"),
    ],
)
def test_a_bad_course_is_refused_in_a_sentence(tmp_path, change, words):
    with pytest.raises(UserError, match=words) as e:
        load_track(written(tmp_path, change))
    assert "course.yaml" in str(e.value) and "\n" not in str(e.value)


def test_a_course_on_the_lawn_has_no_hall(tmp_path):
    course = load_track(written(tmp_path, lambda data: data.update(surroundings="lawn")))
    assert course.hall() is None and load_track("grand-prix").hall() is not None
