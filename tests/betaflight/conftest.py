import pytest

from airrace.betaflight.firmware import find_firmware
from airrace.betaflight.settings import configure
from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.vehicle import load_vehicle


@pytest.fixture(scope="session")
def firmware():
    try:
        return find_firmware()
    except UserError as e:
        pytest.skip(str(e))


@pytest.fixture(scope="session")
def shipped():
    return models_path() / "default" / "betaflight.txt"


@pytest.fixture(scope="session")
def configured(firmware, shipped, tmp_path_factory):
    """A folder with the shipped settings, and what the firmware says of them."""
    folder = tmp_path_factory.mktemp("betaflight")
    return folder, *configure(firmware, shipped, folder)


@pytest.fixture
def sticks(configured):
    return Sticks(configured[1], load_vehicle("Default")[0])
