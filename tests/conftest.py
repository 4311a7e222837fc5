"""What all tests share."""

import gc
import json
import math
import signal
import socket
from pathlib import Path

import pytest
from hypothesis import settings

from airrace.diagrams.warm_up import compile_apart
from airrace.scenario import TRUTH, VIO, Scenario

# The same examples in every run, more of them with --all, and no deadlines: a slow machine is no bug.
# To search for new examples: ./test.bash --hypothesis-profile=search
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=30)
settings.register_profile("all", deadline=None, derandomize=True, max_examples=100)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile("repeatable")

# Started in the background of a script (./test.bash &), Python ignores Ctrl-C, and so does what
# it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Markers that follow from where a test is, by the path below tests/. `slow` stands at each test.
_MARKED = {
    "browser": ["evaluation/test_page_in_browser.py", "visualization/test_in_browser.py"],
    "hitl": ["hitl"],
}


def pytest_addoption(parser):
    parser.addoption("--all", action="store_true", help="run tests that are marked `repeats`, too")


def pytest_configure(config):
    if config.getoption("all") and not config.getoption("--hypothesis-profile"):
        settings.load_profile("all")


def pytest_sessionstart(session):
    """Compiles before the whole suite, most of whose processes would otherwise all do so."""
    whole = session.config.args_source == pytest.Config.ArgsSource.TESTPATHS
    if whole and not hasattr(session.config, "workerinput"):  # which a worker of xdist has
        for estimator in (VIO, TRUTH):
            compile_apart(Scenario(estimator=estimator))


def pytest_collection_modifyitems(config, items):
    for item in items:
        path = item.path.relative_to(Path(__file__).parent)
        for marker, places in _MARKED.items():
            if any(path.is_relative_to(place) for place in places):
                item.add_marker(marker)
    items.sort(key=_turn)
    if not config.getoption("all"):
        repeats = [item for item in items if item.get_closest_marker("repeats")]
        config.hook.pytest_deselected(items=repeats)
        items[:] = [item for item in items if item not in repeats]


def pytest_collection_finish():
    # What is imported by now stays: it takes a twentieth of the time to look through it for garbage,
    # again and again.
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config, log):
    from tests.scheduling import InOrder

    return InOrder(config, log)


def _turn(item):
    """Returns when a test begins, as a number: what takes long comes first.

    In the end, the other processes would wait for it.
    """
    if item.get_closest_marker("browser"):
        return 0
    if item.path.name in ("test_docs.py", "test_style.py"):
        return 1
    return 2 if item.get_closest_marker("slow") else 3


@pytest.fixture(scope="session")
def whole(request):
    """Whether all is to be run as its users do, however long that takes: with --all."""
    return request.config.getoption("all")


@pytest.fixture
def ends():
    """Two sockets that are connected to each other."""
    pair = socket.socketpair()
    yield pair
    for end in pair:
        end.close()


@pytest.fixture(scope="session")
def hexagon(tmp_path_factory):
    """The path of a small track: six gates, explored and raced in 45 s simulated."""
    gates = []
    for k in range(6):
        heading = math.radians(60 * k)
        x, y = 25.0 * math.sin(heading), -25.0 * math.cos(heading)
        left = [x - 5.0 * math.sin(heading), y + 5.0 * math.cos(heading)]
        gates.append({"left_pylon": left, "heading_deg": 60.0 * k})
    track = {
        "name": "hexagon",
        "start": {"position": [-20.0, -25.0, 0.0], "heading_deg": 0.0},
        "hover_height": 5.0,
        "gates": gates,
    }
    path = tmp_path_factory.mktemp("tracks") / "hexagon.yaml"
    path.write_text(json.dumps(track))
    return str(path)
