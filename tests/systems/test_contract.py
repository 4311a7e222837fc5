"""What code of one's own hands over: as wanted, or one sentence that says who gave what."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from airrace.common.errors import UserError
from airrace.systems import contract
from airrace.systems.types import Detection, Detections, ExplorerEvent, ExplorerStatus, PolicyStatus
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate

NAN = float("nan")
MARKER = dict(id=3, corners=np.ones((4, 2)), X_CM=RigidTransform(), reprojection_error=0.1)
ESTIMATE = dict(id=3, count=2, outliers=0, p_WM=np.ones(3), variance=np.ones(3), normal=np.ones(3))
GATE = dict(number=0, p_WG=np.ones(3), heading=0.0, spacing=9.0)
GOOD = [
    Detections(),
    Detections(0.5, (Detection(**MARKER),), (("blur", None),)),
    ExplorerStatus(gates=(0, np.int64(1)), closed_at=3, events=(ExplorerEvent(0.0, "A", "b"),)),
    GateMap(0.5, (MarkerEstimate(**ESTIMATE),), (GateEstimate(**GATE),), refused={"jump": 1}),
    PolicyStatus(),
]


@pytest.mark.parametrize("value", GOOD, ids=lambda value: type(value).__name__)
def test_what_is_as_it_should_be(value):
    contract.check_value("mine", value, type(value))


BAD = [
    (
        Detections,
        None,
        "gave None .*; it must give an instance of airrace.systems.types.Detections",
    ),
    (Detections, [Detection(**MARKER)], r"\(list\)"),
    (Detections, Detections(NAN), r"mine, Detections.time, gave nan \(float\); .*a finite number"),
    (Detections, Detections(1.0, [Detection(**MARKER)]), r"Detections.markers, .*a tuple"),
    (Detections, Detections(1.0, (3,)), "Detections.markers, gave 3 .*a Detection in its tuple"),
    *(
        (Detections, Detections(1.0, (Detection(**MARKER | change),)), words)
        for change, words in [
            (dict(corners=np.ones((2, 4))), r"Detection.corners, .*\(ndarray of shape \(2, 4\)\)"),
            (dict(corners=np.full((4, 2), NAN)), r"array of finite numbers of shape \(4, 2\)"),
            (dict(corners=[[0, 0]] * 4), r"corners, .*\(list\)"),
            (dict(id="3"), "Detection.id, gave '3' .*a whole number"),
            (dict(id=1.0), "a whole number"),
            (dict(X_CM=np.eye(4)), "Detection.X_CM, .*a RigidTransform"),
            (dict(X_CM=RigidTransform([NAN, 0.0, 0.0])), "a finite pose"),
            (dict(covariance=np.eye(3)), r"shape \(6, 6\)"),
        ]
    ),
    (ExplorerStatus, ExplorerStatus(gates=[0, 1]), "ExplorerStatus.gates, .*a tuple"),
    (ExplorerStatus, ExplorerStatus(gates=(0, "1")), "a whole number in its tuple"),
    (ExplorerStatus, ExplorerStatus(done=1), "ExplorerStatus.done, gave 1 .*a bool"),
    (GateMap, GateMap(gates=(GateEstimate(**GATE | dict(heading=NAN)),)), "GateEstimate.heading"),
    (
        GateMap,
        GateMap(markers=(MarkerEstimate(**ESTIMATE | dict(p_WM=np.ones(2))),)),
        r"MarkerEstimate.p_WM, .*shape \(3,\)",
    ),
]


@pytest.mark.parametrize(("kind", "value", "words"), BAD)
def test_what_is_not(kind, value, words):
    with pytest.raises(UserError, match=words):
        contract.check_value("mine", value, kind)


@pytest.mark.parametrize(
    "value",
    [np.ones(3), np.ones((4, 1)), [1.0, 2.0, NAN, 0.0], None, "four", "1", [[1], 2], 1j, {}],
)
def test_what_is_no_vector_of_four(value):
    with pytest.raises(UserError, match=r"mine gave .*; it must give thrust and moments\."):
        contract.finite_vector("mine", value, 4, "thrust and moments")


def test_vectors_and_numbers():
    for value in ([1, 2, 3], (1.0, 2.0, 3.0), np.array([1, 2, 3])):
        result = contract.finite_vector("mine", value, 3, "")
        np.testing.assert_array_equal(result, [1.0, 2.0, 3.0])
    assert contract.finite_number("mine", np.float32(2.0)) == 2.0
    for value in (None, "1", [1.0], NAN):
        with pytest.raises(UserError, match="a finite number"):
            contract.finite_number("mine", value)


def test_a_long_value_is_cut_and_on_one_line():
    with pytest.raises(UserError) as e:
        contract.refuse("mine", np.arange(500.0), "less")
    assert len(str(e.value)) < 300 and "\n" not in str(e.value)
