"""The process that has the serial port of a board: whatever else ends, it disarms.

It hears of thrust and rates from the process that started it. When that ends, however it does, or
says nothing, it disarms; should it end itself, the board hears nothing, and its own failsafe acts.
"""

import pickle
import signal
import socket
import sys
import time

import numpy as np

from airrace.betaflight.board import Board, check_board, rate_of
from airrace.betaflight.guard import Arm, Armed, Ready, Setup, Stop
from airrace.betaflight.msp import open_msp
from airrace.betaflight.sticks import Sticks
from airrace.common.errors import UserError
from airrace.common.processes import real_time_priority
from airrace.hitl.link.message_socket import MessageSocket
from airrace.vehicle import load_vehicle

_FAREWELL = 2.0  # s, for which it disarms at most
_BRIEFEST = 0.2  # s, for which it does at least


def guard(setup: Setup, link: MessageSocket) -> None:
    """Commands a board until it may not be any more.

    Raises:
        UserError: if there is no such board, or it is not what its settings say.
    """
    sticks = Sticks(setup.dump, load_vehicle(setup.drone)[0])
    sticks.channels(np.zeros(4))  # compiles it
    with open_msp(setup.place) as msp, real_time_priority():
        check_board(msp, setup.dump)
        board, period = Board(msp, sticks, may_arm=setup.may_arm), 1.0 / rate_of(setup.dump)
        link.send(pickle.dumps(Ready()))
        told = False
        while board.problem is None:
            end = time.monotonic() + period
            board.step()
            if board.status is not None and board.status.armed and not told:
                told = link.send(pickle.dumps(Armed()))
            while (left := end - time.monotonic()) > 0.0 and not link.is_broken:
                link.wait(left)
                _take(link, board)
            if link.is_broken:
                board.stop("the autonomy has ended")
        link.send(pickle.dumps(Stop(board.problem)))
        _disarm(board, period)


def _take(link: MessageSocket, board: Board) -> None:
    """Does what the other process says."""
    for data in iter(link.receive, None):
        match pickle.loads(data):
            case Arm():
                try:
                    board.arm()
                except UserError as e:
                    board.stop(str(e))
            case Stop(reason):
                board.stop(reason)
            case np.ndarray() as command:
                board.command(command)


def _disarm(board: Board, period: float) -> None:
    """Tells a board to disarm until it says that it has, for a while at most."""
    begin = time.monotonic()
    while (spent := time.monotonic() - begin) < _FAREWELL:
        board.step()
        if spent > _BRIEFEST and board.is_disarmed:
            return
        time.sleep(period)


def main(fileno: int) -> int:
    """Guards a board for the process at the other end of a socket; returns the exit code."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends with the other process
    link = MessageSocket(socket.socket(fileno=fileno))
    data = link.wait_for_message()
    if data is None:
        return 0
    try:
        guard(pickle.loads(data), link)
    except UserError as e:
        link.send(pickle.dumps(Stop(str(e))))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
