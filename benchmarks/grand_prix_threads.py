"""Clients that send much, in real time, for benchmarks.grand_prix: from threads, and floods."""

import socket
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from benchmarks.grand_prix_client import command
from benchmarks.grand_prix_simulation import Simulation

_THREADS, _RATE = 3, 250.0  # commands a second, of all threads
_MODE = 176  # a command that changes nothing, and is answered once it was obeyed
_PATIENCE = 300.0  # s, to compile
_LEVEL = [1.0, 0.0, 0.0, 0.0]
_STILL = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 144, _LEVEL, 0.0, 0.0, 0.0, 0.0)


class ThreadedClient:
    """A client whose threads count their messages alike, each from 0.

    Attributes:
        sent: messages. delays: from a command to its answer (s).
    """

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(1.0)
        self._pictures = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # nobody reads them
        self._pictures.bind(("127.0.0.1", 0))
        self.ports = self._socket.getsockname()[1], self._pictures.getsockname()[1]
        self.sent, self.delays, self._asked = 0, [], 0.0
        self._simulator, self._over, self._lock = None, threading.Event(), threading.Lock()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._over.set()
        self._socket.close()
        self._pictures.close()

    def wait(self) -> None:
        """Waits until the simulator is heard."""
        limit = time.monotonic() + _PATIENCE
        while self._simulator is None and time.monotonic() < limit:
            try:
                self._simulator = self._socket.recvfrom(65536)[1]
            except TimeoutError:
                continue

    def send_for(self, seconds: float, rate: float, threads: int, asks: bool) -> None:
        """Sends set-points from threads; rate: of all (Hz). asks: whether the first asks, too."""
        listener = threading.Thread(target=self._listen, daemon=True)
        senders = [
            threading.Thread(target=self._send, args=(rate / threads, asks and i == 0), daemon=True)
            for i in range(threads)
        ]
        for thread in [listener, *senders]:
            thread.start()
        time.sleep(seconds)
        self._over.set()
        for thread in senders:
            thread.join()

    def _listen(self):
        reader = mavlink.MAVLink(None)
        while not self._over.is_set():
            try:
                data = self._socket.recv(65536)
            except OSError:
                continue
            # A datagram of ours holds one message; only answers are looked into.
            if data[7:10] != b"\x4d\0\0":
                continue
            for message in reader.parse_buffer(data) or []:
                if message.command == _MODE and self._asked:
                    self.delays.append(time.monotonic() - self._asked)
                    self._asked = 0.0

    def _send(self, rate, asks):
        writer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        began, count = time.monotonic(), 0
        while not self._over.is_set():
            due = int(rate * (time.monotonic() - began))
            for _ in range(due - count):
                message = _STILL
                if asks and not self._asked and count % 10 == 0:
                    message, self._asked = command(_MODE), time.monotonic()
                self._socket.sendto(message.pack(writer), self._simulator)
                writer.seq = (writer.seq + 1) % 256
                with self._lock:
                    self.sent += 1
                count += 1
            time.sleep(0.001)


def threads(args) -> dict:
    """Returns what became of 250 commands a second from three threads, in real time."""
    return _measured(args.thread_seconds, _RATE, _THREADS, asks=True)


def flood(args) -> dict:
    """Returns how time goes on while a client sends 20,000 set-points a second."""
    return _measured(args.thread_seconds, 20_000.0, _THREADS, asks=False)


def _measured(seconds, rate, count, asks):
    with tempfile.TemporaryDirectory() as folder, ThreadedClient() as client:
        options = ("--record", "light", "--quirks", "none")
        with Simulation(Path(folder), client.ports, *options, time_limit=1e6) as sim:
            client.wait()
            before = sim.cpu_seconds
            client.send_for(seconds, rate, count, asks)
            spent = sim.cpu_seconds - before
            time.sleep(1.0)
            sim.interrupt()
            race = sim.result()
    link, delays = race["wall"]["link"], np.array(client.delays) * 1e3
    return {
        "seconds": seconds,
        "sent": client.sent,
        "received": link["received"],
        "dropped": link["dropped"],
        "simulated_s": race["simulated_s"],
        "simulated_per_cpu_s": seconds_of(race) / spent,
        "delay_ms": np.percentile(delays, [50, 99]).tolist() if len(delays) else None,
        "answers": len(delays),
    }


def seconds_of(race: dict) -> float:
    """Returns how much was simulated (s)."""
    return float(race["simulated_s"])
