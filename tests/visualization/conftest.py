import pytest

from airrace.track import load_track
from airrace.visualization.meshcat_page import MakeMeshcat


@pytest.fixture(scope="session")
def shared_meshcat():
    return MakeMeshcat(load_track("student-airrace"))


@pytest.fixture
def meshcat(shared_meshcat):
    """An empty page."""
    shared_meshcat.Delete()
    shared_meshcat.DeleteAddedControls()
    return shared_meshcat
