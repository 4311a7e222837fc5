import cv2
import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from airrace.scenario import CORNERS, POSES
from airrace.systems.perception import detection_checks as checks
from airrace.systems.perception.aruco_detector import ArucoDetector, DetectorState, detect
from airrace.systems.perception.marker_measurement import DetectorConfig
from airrace.systems.perception.marker_search import MarkerSearch, make_detector
from airrace.systems.sensing.camera_view import CameraView
from airrace.track import MARKER_SIZE
from tests.systems.perception.marker_pictures import INFO, gate, picture, pose, project

GATE = dict(zip((0, 2), gate(pose(-0.5, 0.3, 18.0, yaw=0.3))))
LONE = {39: pose(0.0, 2.0, 15.0, yaw=-0.4)}
EMPTY = np.full((720, 1280), 120, np.uint8)


def show(detector, context, grey, time):
    view = Value[object](CameraView.of(grey))
    detector.GetInputPort("camera_view").FixValue(context, view)
    detector.GetInputPort("camera_image_time").FixValue(context, [time])
    detector.GetInputPort("camera_info").FixValue(context, Value[object](INFO))


def detected(grey, time=1.5, **kwargs):
    detector = ArucoDetector(config=DetectorConfig(**kwargs))
    context = detector.CreateDefaultContext()
    show(detector, context, grey, time)
    return detector.get_output_port().Eval(context)


def ids(detections):
    return [m.id for m in detections.markers]


@pytest.mark.slow
@pytest.mark.parametrize("poses", POSES)
@pytest.mark.parametrize("corners", CORNERS)
def test_finds_markers_and_their_poses(corners, poses):
    truth = GATE | LONE
    found = detected(picture(truth), corners=corners, poses=poses)
    assert found.time == 1.5 and found.refused == ()
    assert ids(found) == [0, 2, 39]
    for marker in found.markers:
        X_CM = truth[marker.id]
        assert marker.joint == (marker.id != 39 and poses == "gate")
        assert marker.face == ("back" if marker.id == 39 else "front")
        error = marker.X_CM.translation() - X_CM.translation()
        share = 0.005 if corners == "refit" else 0.02
        assert np.linalg.norm(error) < share * X_CM.translation()[2]
        atol = 0.15 if corners == "refit" else 0.7
        np.testing.assert_allclose(marker.corners, project(X_CM), atol=atol)
        assert marker.X_CM.rotation().IsNearlyEqualTo(
            X_CM.rotation(), 0.1 if poses == "gate" else 0.3
        )
        assert marker.covariance.shape == (6, 6) and not marker.covariance.flags.writeable
        assert marker.reprojection_error < (0.1 if corners == "refit" else 0.5)


@pytest.mark.parametrize("id", [39, 500])
def test_corners_and_poses_of_opencv_are_opencvs(id):
    """Those of its detector with CORNER_REFINE_SUBPIX, and SOLVEPNP_IPPE_SQUARE of these."""
    grey = picture({id: LONE[39]}, blur=0.6, noise=2.0)
    parameters = make_detector(refine=False).getDetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL)
    (quad,), _, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    quad = quad.reshape(4, 2).astype(float)
    (refitted,) = detected(grey).markers
    (marker,) = detected(grey, corners="opencv", poses="marker").markers
    np.testing.assert_array_equal(marker.corners, quad)
    assert 0.02 < np.abs(marker.corners - refitted.corners).max() < 1.0
    half = MARKER_SIZE / 2 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    _, turn, p_CM = cv2.solvePnP(half, quad, INFO.K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    np.testing.assert_allclose(marker.X_CM.translation(), p_CM.ravel(), atol=1e-9)
    np.testing.assert_allclose(marker.X_CM.rotation().matrix(), cv2.Rodrigues(turn)[0], atol=1e-6)


@pytest.mark.parametrize("poses", POSES)
def test_opencvs_corners_are_the_same_where_the_marker_is_expected(poses):
    """A region of the picture is all that its refinement needs."""
    pictures = [picture({7: pose(0.1 * k, 0.4, 15 - 0.3 * k, yaw=0.2)}) for k in range(4)]
    tracked, calls = watch(pictures, corners="opencv", poses=poses)
    assert calls == ["everywhere", *3 * ["around"]]
    searched, _ = watch(pictures, corners="opencv", poses=poses, full_search_periods=(1, 1))
    for a, b in zip(tracked, searched):
        (a,), (b,) = a.detections.markers, b.detections.markers
        np.testing.assert_allclose(a.corners, b.corners, atol=1e-3)


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_nothing_in_an_empty_image(grey):
    assert detected(np.full((720, 1280), grey, np.uint8)).markers == ()


def test_nothing_in_noise():
    noise = np.random.default_rng(0).integers(0, 256, (720, 1280), dtype=np.uint8)
    assert detected(noise).markers == ()


def test_half_an_image():
    grey = picture(GATE | LONE)
    grey[:, 640:] = 0
    assert set(ids(detected(grey))) < {0, 2, 39}


@pytest.mark.parametrize("shape", [(1, 1), (360, 640), (1280, 720)])
def test_images_of_a_wrong_size_are_refused(shape):
    found = detected(np.zeros(shape, np.uint8))
    assert found.markers == () and found.refused == ((checks.WRONG_IMAGE, None),)


def test_an_image_without_a_time_is_refused():
    found = detected(picture(LONE), time=np.nan)
    assert found.markers == () and found.refused == ((checks.NO_TIME, None),)


def test_foreign_ids():
    grey = picture({500: LONE[39]})
    assert ids(detected(grey)) == [500]
    found = detected(grey, max_id=79)
    assert found.markers == () and found.refused == ((checks.FOREIGN_ID, 500),)


@pytest.mark.parametrize("id", [79, 80, 500, 1022])
@pytest.mark.parametrize("quarters", range(4))
def test_all_ids_are_read_whatever_is_up(id, quarters):
    X_CM = pose(0.5, 0.3, 12.0, yaw=0.3, roll=quarters * np.pi / 2 + 0.1)
    (found,) = detected(picture({id: X_CM})).markers
    assert found.id == id
    np.testing.assert_allclose(found.corners, project(X_CM), atol=0.15)


def test_the_same_id_twice_is_refused():
    grey = np.minimum(picture({4: pose(-3, 0, 12)}), picture({4: pose(3, 0, 12)}))
    assert detected(grey).refused == 2 * ((checks.SEEN_TWICE, 4),)


def test_a_gate_with_its_markers_swapped_is_refused():
    found = detected(picture(dict(zip((2, 0), GATE.values()))))
    assert found.markers == ()
    assert found.refused == ((checks.FROM_BEHIND, 0), (checks.FROM_BEHIND, 2))


class CountingSearch(MarkerSearch):
    """Says where it has searched."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.calls = []

    def everywhere(self, image):
        self.calls.append("everywhere")
        return super().everywhere(image)

    def around(self, view, predictions):
        self.calls.append("around")
        return super().around(view, predictions)


def watch(pictures, **kwargs):
    """Detects markers in pictures at 30 Hz; returns the results, and where was searched."""
    results, config = [DetectorState()], DetectorConfig(**kwargs)
    search = CountingSearch(refine=config.corners == "opencv")
    for k, grey in enumerate(pictures):
        results.append(detect(search, CameraView.of(grey), k / 30, INFO, results[-1], config))
    return results[1:], search.calls


def test_tracking_finds_the_same_in_less_of_the_image():
    pictures = [
        picture({id: pose(0.1 * k, 0, 15 - 0.3 * k, yaw=0.2)}) for id in (7,) for k in range(7)
    ]
    tracked, calls = watch(pictures)
    assert calls == ["everywhere", *6 * ["around"]]
    searched, calls = watch(pictures, full_search_periods=(1, 1))
    assert calls == 7 * ["everywhere"]
    for a, b in zip(tracked, searched):
        (a,), (b,) = a.detections.markers, b.detections.markers
        np.testing.assert_allclose(a.corners, b.corners, atol=1e-3)


def test_all_of_an_image_is_searched_every_few_images():
    results, calls = watch(4 * [EMPTY] + 6 * [picture(LONE)], full_search_periods=(3, 3))
    assert calls == 3 * ["everywhere", "around", "around"] + ["everywhere"]
    assert [ids(s.detections) for s in results] == 6 * [[]] + 4 * [[39]]


def test_a_lost_marker_is_found_by_the_next_full_search():
    moved = picture({39: pose(-4, -2, 15)})
    results, _ = watch([picture(LONE), *4 * [moved]], full_search_periods=(3, 3))
    assert [ids(s.detections) for s in results] == [[39], [], [], [39], [39]]


def test_new_markers_are_found_by_the_next_full_search():
    results, _ = watch([picture(LONE), *8 * [picture(LONE | GATE)]])
    assert ids(results[-2].detections) == [39]
    assert ids(results[-1].detections) == [0, 2, 39]


def test_all_is_searched_less_often_while_nothing_comes_or_goes():
    _, calls = watch(60 * [picture(LONE)])
    assert [k for k, call in enumerate(calls) if call == "everywhere"] == [0, 8, 24, 40, 56]


def test_all_is_searched_sooner_again_when_a_marker_has_left():
    _, calls = watch(30 * [picture(LONE | GATE)] + 20 * [picture(LONE)])
    assert [k for k, call in enumerate(calls) if call == "everywhere"] == [0, 8, 24, 32, 48]


def test_after_a_gap_all_of_an_image_is_searched():
    search = CountingSearch()
    view = CameraView.of(picture(LONE))
    first = detect(search, view, 0.0, INFO, DetectorState())
    detect(search, view, 0.5, INFO, first)
    assert search.calls == 2 * ["everywhere"]


def test_only_expected_markers_are_found_where_they_are_expected():
    search, view = MarkerSearch(), CameraView.of(picture(LONE))
    corners = project(LONE[39])
    for id in (39, 38, 1000):
        found, quads = search.around(view, {7: corners - 300, id: corners})
        assert found == ([39] if id == 39 else [])
        assert quads.shape == (len(found), 4, 2)
    assert search.around(view, {})[0] == []


@pytest.mark.parametrize("off", [[24.0, 0.0], [0.0, -24.0], [-24.0, 24.0]])
def test_one_that_is_not_quite_where_it_is_expected_is_found_all_the_same(off):
    search, view = MarkerSearch(), CameraView.of(picture(LONE))
    corners = project(LONE[39])
    found, quads = search.around(view, {39: corners + off})
    assert found == [39]
    np.testing.assert_allclose(quads[0], corners, atol=2.5)


@pytest.mark.parametrize("poses", POSES)
@pytest.mark.parametrize("corners", CORNERS)
def test_a_pose_that_jumps_is_refused_until_it_stays(corners, poses):
    near, far = (picture({39: pose(0.3, 0.4, z, yaw=0.2)}) for z in (12.0, 16.0))
    results, _ = watch([far, near, near], corners=corners, poses=poses)
    assert [ids(s.detections) for s in results] == [[39], [], [39]]
    assert results[1].detections.refused == ((checks.JUMP, 39),)


def test_a_pose_that_jumps_is_taken_without_the_filter():
    near, far = (picture({39: pose(0, 0, z)}) for z in (12.0, 16.0))
    results, _ = watch([far, near, near], jump_filter=False)
    assert [ids(s.detections) for s in results] == 3 * [[39]]
    assert all(s.detections.refused == () for s in results)


def test_the_image_is_searched_once():
    detector = ArucoDetector()
    detector._search = search = CountingSearch()
    simulator = Simulator(detector)
    context = simulator.get_mutable_context()
    show(detector, context, picture(LONE), 0.0)
    first = detector.get_output_port().Eval(context)
    # The detector remembers the image, which must not change what is in it.
    simulator.AdvanceTo(0.09)
    assert detector.get_output_port().Eval(context) is first
    assert search.calls == ["everywhere"]
    show(detector, context, picture(LONE), 0.09)
    assert ids(detector.get_output_port().Eval(context)) == [39]
    assert search.calls == ["everywhere", "around"]
