"""Datagrams that are no good, for benchmarks.grand_prix."""

import math
import random
import socket

from pymavlink.dialects.v20 import common as mavlink

from benchmarks.grand_prix_client import ARM, RESET, Client, command, hover, place

# Kind of a datagram, to the counters of the simulator that show it; a damaged type may be one
# that MAVLink does not have. Nobody reads the picture port, so nothing counts what comes there.
KINDS = {
    "random bytes": ("malformed", "unknown"),
    "cut off": ("malformed",),
    "bad checksum": ("malformed", "unknown"),
    "oversized": ("oversized",),
    "not a number": ("refused",),
    "of a stranger": ("strangers",),
    "to the picture port": (),
}
_QUIET = 62  # messages of the IMU, before it begins
_NAN = math.nan


class NoisyClient(Client):
    """A client that hovers, and around whose commands everything goes wrong.

    Attributes:
        noise: how many datagrams of each of KINDS were sent.
    """

    def __init__(self, datagrams: int, per_step: int, seed: int, **options):
        """Args: datagrams: in all. per_step: before each command. seed: of what they are."""
        super().__init__(**options)
        self.noise = dict.fromkeys(KINDS, 0)
        self._left, self._per_step, self._random = datagrams, per_step, random.Random(seed)
        self._stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stranger.bind(("127.0.0.1", 0))

    def __exit__(self, *error):
        super().__exit__(*error)
        self._stranger.close()

    def reply(self, number: int) -> None:
        good = hover(number)
        with_it = b""
        if number > _QUIET and self.picture_source is not None:
            # What is cut off before ends here, and does not go on in the good command.
            self.send(self.pack(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)))
            for _ in range(min(self._per_step, self._left)):
                with_it += self._make_noise()
                self._left -= 1
        data = b"".join(map(self.pack, good))
        # A refused command is an answer, too: alone, it would take the place of the good one.
        self.send(with_it + data)

    def _make_noise(self):
        """Sends a bad datagram; returns what goes into that of the good command."""
        rng = self._random
        kind = rng.choice(list(KINDS))
        if kind == "not a number" and not self._left % 3:
            kind = "random bytes"
        self.noise[kind] += 1
        if kind == "not a number":
            return self.pack(rng.choice(_NOT_NUMBERS))
        if kind == "of a stranger":
            message = rng.choice([command(RESET), command(ARM, 0.0), place(9.0, 9.0, -9.0)])
            self._stranger.sendto(_packed(message, rng.randrange(256)), self.simulator)
        elif kind == "to the picture port":
            self._stranger.sendto(rng.randbytes(rng.randrange(1, 1500)), self.picture_source)
        else:
            self.send(self._bad(kind))
        return b""

    def _bad(self, kind):
        rng = self._random
        good = _packed(place(1.0, 2.0, -3.0), rng.randrange(256))
        if kind == "random bytes":
            return rng.randbytes(rng.randrange(1, 300))
        if kind == "oversized":
            return good + rng.randbytes(rng.randrange(4097, 20000))
        if kind == "cut off":
            return good[: rng.randrange(1, len(good))]
        i = rng.randrange(1, len(good))
        return good[:i] + bytes([good[i] ^ rng.randrange(1, 256)]) + good[i + 1 :]


def _packed(message, number):
    """Returns a message of a client with a number."""
    writer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    writer.seq = number
    return message.pack(writer)


_NOT_NUMBERS = [
    place(_NAN, 0.0, 0.0),
    place(0.0, math.inf, 0.0),
    command(ARM, _NAN),
    mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, 128, [1.0, 0.0, 0.0, 0.0], _NAN, 0.0, 0.0, 0.5
    ),
    mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, 4 * [_NAN], 0.0, 0.0, 0.0, 0.5),
    mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, [_NAN, *7 * [0.2]]),
]
