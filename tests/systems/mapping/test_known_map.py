"""The systems that know a map already."""

from airrace.systems.mapping.known_map import KnownMap, NoDetector
from airrace.systems.types import Detections
from airrace.track.map_files import read_map


def test_the_boxes_show_what_they_were_given():
    truth = read_map("track", "student-airrace")
    box = KnownMap(truth)
    assert box.GetOutputPort("gate_map").Eval(box.CreateDefaultContext()) is truth
    box = NoDetector()
    seen = box.GetOutputPort("detections").Eval(box.CreateDefaultContext())
    assert isinstance(seen, Detections) and not seen.markers
