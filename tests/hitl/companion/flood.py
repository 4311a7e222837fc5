"""Floods the bus of a race with what should be dropped.

    python flood.py URL CHANNELS EACH RATE

Waits until it has heard a message on every one of the channels (names with commas between
them). Then it sends, at a rate (Hz), EACH copies of them on each, which have been overtaken by
then, and EACH torn or twisted ones. Says when it has heard, and when it has sent all.
"""

import random
import sys
import time

from airrace.hitl.link.udp_bus import UdpBus

_PAUSE = 1.0  # s, after which what was heard is old


def listen(bus: UdpBus, channels) -> dict:
    """Returns the first message of every channel."""
    heard = {}
    for channel in channels:
        bus.subscribe(channel, heard.setdefault)
    while len(heard) < len(channels):
        bus.wait(0.1)
        while bus.hand_over():
            pass
    return heard


def spoil(data: bytes, rng: random.Random) -> bytes:
    """Returns a message with an end torn off, or some bytes of another value."""
    if rng.random() < 0.5:
        return data[: rng.randrange(len(data))]
    spoilt = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        spoilt[rng.randrange(len(data))] ^= rng.randint(1, 255)
    return bytes(spoilt)


def flood(bus: UdpBus, messages: dict, each: int, rate: float) -> None:
    """Sends each message so often as it is, and as often spoilt."""
    rng, due = random.Random(0), time.monotonic()
    for _ in range(each):
        for channel, data in messages.items():
            for bad in (data, spoil(data, rng)):
                bus.publish(channel, bad)
                due += 1.0 / rate
                time.sleep(max(due - time.monotonic(), 0.0))


if __name__ == "__main__":
    bus = UdpBus(sys.argv[1])
    messages = listen(bus, sys.argv[2].split(","))
    print("heard", flush=True)
    time.sleep(_PAUSE)
    flood(bus, messages, int(sys.argv[3]), float(sys.argv[4]))
    print("sent", flush=True)
