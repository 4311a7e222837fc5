import numpy as np
import pytest
from pydrake.math import RigidTransform

from airrace.recording import scene_updates
from airrace.systems.types import Detection, Detections
from airrace.track import load_track
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.vehicle import load_vehicle
from tests.recording.decoding import decoded, vector


@pytest.mark.parametrize("drone, rotors", [("Default", 4), ("StarOne", 8)])
def test_the_track_and_the_drone(drone, rotors):
    track = load_track("student-airrace")
    message = decoded(scene_updates.track_scene(0.0, track, load_vehicle(drone)[0]))
    gates, body = message.entities
    assert (gates.frame_id, body.frame_id, body.frame_locked) == ("world", "body", True)
    assert len(gates.cylinders) == 20 and len(gates.cubes) == 2 * 40
    feet = [vector(c.pose.position)[:2] for c in gates.cylinders]
    np.testing.assert_allclose(feet, track.pylons()[:, :2])
    assert {t.text for t in gates.texts} == {
        *map(str, range(40)),
        *(f"gate {n}" for n in range(1, 11)),
    }
    assert len(body.cylinders) == rotors
    # The black square lies in front of the white board.
    white, black = gates.cubes[0].pose.position, gates.cubes[1].pose.position
    out = track.boards()[0].X_WM.rotation().col(2)
    assert np.dot(out, np.subtract(vector(black), vector(white))) > 0.001


def test_the_map_shows_its_uncertainty():
    marker = MarkerEstimate(
        id=0,
        count=9,
        outliers=0,
        p_WM=np.array([1.0, 2.0, 6.0]),
        variance=np.array([0.04, 0.01, 0.0]),
        normal=np.array([-1.0, 0, 0]),
    )
    gate = GateEstimate(number=0, p_WG=np.array([1.0, 2.0, 6.0]), heading=0.0, spacing=10.0)
    (entity,) = decoded(scene_updates.map_scene(1.0, GateMap(1.0, (marker,), (gate,)))).entities
    (ellipsoid,), (line,) = entity.spheres, entity.lines
    np.testing.assert_allclose(vector(ellipsoid.size), [2 * 0.6, 2 * 0.3, 0.1], rtol=1e-6)
    np.testing.assert_allclose([vector(p) for p in line.points], [[1, 7, 6], [1, -3, 6]])


def test_a_path_is_coloured_by_speed():
    (entity,) = decoded(
        scene_updates.path_scene(1.0, [[0, 0, 1], [1, 0, 1]], [0.0, 99.0], 20.0)
    ).entities
    slow, fast = entity.lines[0].colors
    assert (slow.r, slow.b) == (0.0, 1.0) and (fast.r, fast.b) == (1.0, 0.0)


def test_rays_go_from_the_camera_to_the_markers():
    marker = Detection(
        id=8, corners=np.zeros((4, 2)), X_CM=RigidTransform([1.0, 2.0, 9.0]), reprojection_error=0.1
    )
    (entity,) = decoded(scene_updates.detection_rays(Detections(2.0, (marker,)))).entities
    assert entity.frame_id == "camera"
    assert [vector(p) for p in entity.lines[0].points] == [[0, 0, 0], [1, 2, 9]]
