from pathlib import Path

import numpy as np
from pymavlink import mavutil

from airrace.mavlink import telemetry
from airrace.mavlink.client_log import ClientLog
from airrace.mavlink.dialects import DIALECTS
from airrace.recording import race_events as events
from airrace.systems.types import ExplorerStatus, GateCrossing
from airrace.vehicle.state import State
from tests.worlds.mavlink_client import arm, rates


def test_a_log_is_read_by_pymavlink_and_a_line_a_second_says_what_came(tmp_path):
    notes, beat = [], telemetry.heartbeat(DIALECTS["official"], armed=True)
    state = State(0.0, np.array([1.0, 0, 0, 0]), np.array([1.0, 2, 3]), *np.zeros((2, 3)))
    with ClientLog(tmp_path / "race.tlog", notes.append) as log:
        for second in range(3):
            for message in (arm(), *[rates(0.1) for _ in range(second)]):
                log.tap(second + 0.5, False, _bytes(message))
            for _ in range(10):
                log.tap(second + 0.6, True, _bytes(beat))
            log.take(events.StateSample(second + 0.9, state))
            log.take(events.RaceEvent(second + 1.0))
        log.take(events.ExplorerChanged(3.5, ExplorerStatus(state="RACE", done=True), ()))
        crossing = GateCrossing(time=3.6, gate=1, lap=1, offset=0.1, max_speed=2.0)
        log.take(events.GateCrossed(3.6, crossing))
        log.take(events.RaceEvent(4.0))
    reader = mavutil.mavlink_connection(str(tmp_path / "race.tlog"))
    kinds = []
    while (message := reader.recv_match()) is not None:
        kinds.append(message.get_type())
    assert kinds.count("COMMAND_LONG") == 3 and kinds.count("SET_ATTITUDE_TARGET") == 3
    assert kinds.count("HEARTBEAT") == 30
    assert "BAD_DATA" not in kinds
    assert (
        len(notes) == 4 and "ON_PAD, 0 gates at (1.0 2.0 3.0) m, 0.0 m/s; heard 1 COM" in notes[0]
    )
    assert "heard 2 SET_ATTITUDE_TARGET, 1 COMMAND_LONG" in notes[2]
    assert "heard nothing; told 0" in notes[3] and "RACE, 1 gates" in notes[3]


def test_a_full_disk_ends_the_log_and_not_the_race():
    notes, beat = [], telemetry.heartbeat(DIALECTS["official"], armed=True)
    with ClientLog(Path("/dev/full"), notes.append) as log:
        for i in range(1000):
            log.tap(0.01 * i, True, _bytes(beat))
    (said,) = notes
    assert said.startswith("/dev/full cannot be written any more (") and said.endswith("ends here.")


def _bytes(message):
    return message.pack(mavutil.mavlink.MAVLink(None, srcSystem=1))
