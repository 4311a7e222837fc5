"""A board is told sticks, and disarmed whenever something is not as it should be."""

import struct

import numpy as np
import pytest

from airrace.betaflight import msp
from airrace.betaflight.board import Board, check_board, rate_of
from airrace.betaflight.msp import Frame
from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError
from airrace.vehicle import load_vehicle
from tests.betaflight.test_sticks import DUMP

HOVER = np.array((9.81, 0.0, 0.0, 0.0))
ARM = 6  # channel of DUMP that arms


def status(armed, reasons=0):
    return struct.pack("<3HIBHBBBBI", 0, 0, 0, int(armed), 0, 0, 3, 0, 0, 29, reasons)


class Link:
    """Plays a board that arms at once, and answers as long as it is there."""

    def __init__(self):
        self.told, self.answers, self.arms, self.refuses = [], True, True, 0
        self.armed = self._asked = False

    def set_raw_rc(self, channels):
        self.told.append(list(channels))
        if channels[2] > 1000 and not self.armed:
            self.refuses |= 1 << 7  # the throttle is not down
        self.armed = self.arms and channels[ARM] > 1700 and (self.armed or not self.refuses)

    def tell(self, command):
        self._asked = True

    def heard(self):
        asked, self._asked = self._asked, False
        answer = Frame(msp.STATUS_EX, status(self.armed, self.refuses), False)
        return [answer] if asked and self.answers else []


class Flight:
    """A board, its link, and the time."""

    def __init__(self, **options):
        self.time, self.link = 10.0, Link()
        sticks = Sticks(DUMP, load_vehicle("Default")[0])
        self.board = Board(self.link, sticks, clock=lambda: self.time, **options)

    def go(self, duration, command=HOVER):
        """Goes on; returns the last sticks."""
        for _ in range(round(duration / 0.01)):
            self.time += 0.01
            if command is not None:
                self.board.command(command)
            self.board.step()
        return self.link.told[-1]


@pytest.fixture
def armed():
    flight = Flight(may_arm=True)
    flight.board.arm()
    flight.go(0.5)
    assert flight.link.armed and flight.board.problem is None
    return flight


def test_it_is_not_armed_unless_that_is_allowed():
    flight = Flight()
    sticks = flight.go(1.0)
    assert sticks[ARM] == 1000 and sticks[2] > 1400  # a person may arm with a radio of their own
    with pytest.raises(UserError, match="--allow_arming"):
        flight.board.arm()


def test_it_arms_with_the_throttle_down_and_then_follows(armed):
    told = armed.link.told
    first = next(i for i, sticks in enumerate(told) if sticks[2] > 1050)
    assert all(sticks[2] == 1000 for sticks in told[:first]) and first > 1
    assert told[-1][2] > 1400 and told[-1][ARM] == 1900


def test_a_board_without_commands_is_disarmed_for_good(armed):
    sticks = armed.go(0.3, None)
    assert armed.board.problem == "the autonomy has commanded nothing for 0.2 s"
    assert sticks[2] == 1000 and sticks[ARM] == 1000
    assert armed.go(0.3)[ARM] == 1000


def test_commands_that_are_no_numbers_are_none(armed):
    assert armed.go(0.3, HOVER * np.nan)[ARM] == 1000


def test_a_board_that_does_not_answer_is_disarmed(armed):
    armed.link.answers = False
    assert armed.go(0.7)[ARM] == 1000
    assert armed.board.problem == "the board has not answered for 0.5 s"


def test_a_board_that_disarms_is_not_armed_again(armed):
    armed.link.arms = armed.link.armed = False
    assert armed.go(0.3)[ARM] == 1000
    assert armed.board.problem == "the board has disarmed"
    armed.link.arms = True
    armed.go(0.3)
    assert not armed.link.armed


def test_a_board_that_does_not_arm_says_why():
    flight = Flight(may_arm=True)
    flight.link.arms, flight.link.refuses = False, 1 << 7 | 1 << 12
    flight.board.arm()
    assert flight.go(4.0)[ARM] == 1000  # the switch is raised when nothing is in the way
    flight.go(1.5)
    assert flight.board.problem == "the board does not arm (THROTTLE, CALIB)"


def test_a_link_that_breaks_is_said(armed):
    def broken(channels):
        raise UserError("The link to the board is gone: connect again.")

    armed.link.set_raw_rc = broken
    armed.board.step()
    assert "link to the board is gone" in armed.board.problem


class Tuned:
    """Plays a board with some settings."""

    def __init__(self, **changes):
        values = dict.fromkeys(("roll_rc_rate", "pitch_rc_rate", "yaw_rc_rate"), "20")
        self.values = values | {"rates_type": "ACTUAL"} | changes
        self.firmware, self.armed, self.ranges = "BTFL 4.6.0", False, ((0, 2, 1700, 2100),)
        self.channels = 0, 1, 3, 2

    def version(self):
        return self.firmware

    def status(self):
        return msp.Status(0, int(self.armed), 0)

    def tuning(self):
        return msp.Tuning(self.values, self.channels, self.ranges)


def test_a_board_that_is_another_than_its_settings_say_is_refused():
    check_board(Tuned(), DUMP)
    with pytest.raises(UserError, match="roll_rc_rate = 60, and the settings that you give 20"):
        check_board(Tuned(roll_rc_rate="60"), DUMP)
    for name, value, words in (
        ("firmware", "INAV 7.0.0", "INAV 7.0.0, which is no Betaflight"),
        ("armed", True, "is armed: disarm it"),
        ("ranges", ((0, 3, 1700, 2100),), "ranges that arm"),
        ("channels", (1, 0, 3, 2), "map"),
    ):
        board = Tuned()
        setattr(board, name, value)
        with pytest.raises(UserError, match=words):
            check_board(board, DUMP)


def test_it_is_told_no_more_than_it_reads():
    assert rate_of(DUMP) == 50.0
    assert rate_of(DUMP + "set serial_update_rate_hz = 2000\n") == 250.0
