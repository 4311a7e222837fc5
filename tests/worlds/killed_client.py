"""A client that climbs, and is killed in flight: `python killed_client.py PORT SECONDS`.

It answers every HIGHRES_IMU with one command, and after so many seconds of simulated time nothing
of it is left. It is a process of its own, which needs nothing but pymavlink.
"""

import os
import signal
import socket
import sys

from pymavlink.dialects.v20 import common as mavlink

VELOCITY_ONLY = 0b110111000111  # type_mask of SET_POSITION_TARGET_LOCAL_NED
CLIMB = mavlink.MAVLink_set_position_target_local_ned_message(
    0, 1, 1, 1, VELOCITY_ONLY, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, *5 * [0.0]
)
ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, *6 * [0.0])


def main(port: int, seconds: float) -> None:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", port))
    reader, writer = mavlink.MAVLink(None), mavlink.MAVLink(None, srcSystem=255)
    armed = False
    # Its first word is a heartbeat; from then on, time goes on.
    answers = [mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)]
    while True:
        data, simulator = udp.recvfrom(65536)
        for message in reader.parse_buffer(data) or []:
            if message.get_type() == "HIGHRES_IMU":
                if message.time_usec > 1e6 * seconds:
                    os.kill(os.getpid(), signal.SIGKILL)
                answers.append(CLIMB if armed else ARM)
                armed = True
        for answer in answers:
            udp.sendto(answer.pack(writer), simulator)
            writer.seq = (writer.seq + 1) % 256
        answers = []


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
