import numpy as np

from airrace.systems.types import ExplorerStatus, GateCrossing, RefereeStatus
from tools.scoreboard import Moment, draw_lines, scoreboard_lines

RACING = ExplorerStatus(state="DONE", done=True, gates=(0, 1, 2))


def _report(times, **fields):
    crossings = tuple(
        GateCrossing(time=t, gate=k % 3 + 1, lap=k // 3 + 1, offset=0.0, max_speed=9.0)
        for k, t in enumerate(times)
    )
    return RefereeStatus(
        **{
            "crossings": crossings,
            "finished": False,
            "dnf_reason": None,
            "end_time": None,
            "collisions": 0,
            **fields,
        }
    )


def _lines(times, status=RACING, time=100.0, plans=(), **fields):
    return scoreboard_lines(Moment(time, 9.0, _report(times, **fields), status, plans), 3, 2)


def test_exploring():
    lines = _lines([], ExplorerStatus(state="FLY_TO_GATE", gates=(0, 1)), 12.34)
    assert lines == ["exploring: 2 gates found, FLY_TO_GATE", "12.3 s    9.0 m/s"]


def test_splits_in_the_first_lap_have_nothing_to_compare_with():
    assert _lines([80.0, 84.5], time=85.0)[2:] == ["lap 1    5.0 s", "gate 2    4.50 s"]
    assert _lines([80.0, 84.5])[0] == "racing: lap 1 of 2, next gate 3"


def test_splits_are_compared_with_the_best_lap():
    lines = _lines([10.0, 14.0, 17.0, 20.0, 23.5], time=24.0)
    assert lines[0] == "racing: lap 2 of 2, next gate 3"
    assert lines[2:] == ["lap 1    10.00 s    +0.00", "lap 2    4.0 s", "gate 2    3.50 s    -0.50"]


def test_a_lap_on_an_earlier_plan_says_so():
    crossings = np.arange(0.0, 31.0, 3.0)  # three laps, and two gates of a fourth
    lines = _lines(crossings, time=34.0, plans={1, 2})
    assert lines[2:6] == [
        "lap 1    9.00 s    +0.00",
        "lap 2    9.00 s    +0.00",
        "lap 3    9.00 s    +0.00    plan of lap 2",
        "lap 4    7.0 s    plan of lap 2",
    ]
    # The next lap's plan is in force before the lap begins.
    assert _lines(crossings, time=34.0, plans={1, 2, 5}) == lines
    assert _lines(crossings, time=34.0, plans={1, 2, 4})[5] == "lap 4    7.0 s"


def test_the_end():
    lines = _lines([10.0, 14, 17, 20, 23, 26, 29.0], finished=True, end_time=29.0)
    assert lines[0] == "finished"
    assert lines[2:] == ["lap 1    10.00 s    +0.00", "lap 2    9.00 s    -1.00"]
    lines = _lines([10.0], dnf_reason="hit the ground", end_time=11.0)
    assert lines[0] == "did not finish: hit the ground"


def test_the_longest_line_fits():
    lap = "lap 88    88.88 s    +88.88    plan of lap 88"
    right = draw_lines(["", lap])[:, -14:]
    assert (right == right[0, 0]).all()


def test_the_text_can_be_read():
    image = draw_lines(["racing", "10.0 s"])
    assert image.dtype == np.uint8 and image.shape[2] == 3
    bright = (image > 200).all(axis=2)
    assert bright[: len(image) // 2].sum() > 100 and bright[len(image) // 2 :].sum() > 50
