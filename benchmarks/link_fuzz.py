"""A race in real time over a link on which somebody sends ten thousands of broken datagrams.

    python -m benchmarks.link_fuzz [--minutes 1] [--rate 2000] [--link_key FILE]
        [--realtime_rate 1] [--track hexagon] [--seed 0]

The race is in a network of its own, which takes root. The datagrams are those of the race itself,
with some bytes changed, cut, or made more. The race flies as many laps as the time allows; it
passes if it finishes them. The table has what each process received and dropped, by cause.
"""

import argparse
import collections
import json
import random
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.link.datagrams import LARGEST
from airrace.hitl.link.endpoint import DEFAULT_URL
from benchmarks import harness
from tests.worlds.mutations import mutated_bytes
from tests.worlds.network import CAN_UNSHARE, own_network

_GROUP = "239.255.76.67", 7667  # of DEFAULT_URL
_KEPT = 500  # datagrams of the race that are mutated, the newest
_MOST = 65_507  # bytes of a datagram over UDP
_PERIOD = 0.005  # s from one burst to the next
_EXPLORING, _LAP = 36.0, 9.6  # s of simulated time on the hexagon, about


def main(argv=None) -> int:
    """Flies the race and prints the table."""
    parser = harness.make_parser(__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="(default: %(default)s)")
    parser.add_argument(
        "--rate", type=harness.count, default=2000, help="datagrams a second (default: %(default)s)"
    )
    parser.add_argument("--link_key", type=Path, metavar="FILE", help="of both sides of the race")
    parser.add_argument("--realtime_rate", type=float, default=1.0, help="(default: %(default)s)")
    parser.add_argument("--track", default="hexagon")
    parser.add_argument("--seed", type=int, default=0)
    return harness.run(parser, argv, measure, show)


def measure(args: argparse.Namespace) -> dict:
    """Returns what race.json says of the race, and how many datagrams were sent in what time."""
    if not CAN_UNSHARE:
        raise UserError("A network of one's own takes root: call it as root, on Linux.")
    time_flown = 60.0 * args.minutes * args.realtime_rate
    laps = max(1, round((time_flown - _EXPLORING) / _LAP))
    with tempfile.TemporaryDirectory() as folder, own_network(), _Attacker(args.seed) as attacker:
        output = Path(folder) / "race"
        text = f"{{referee: {{time_limit: {10 * time_flown + 600}}}}}"
        race = [sys.executable, "-m", "airrace", "race", "-s", "HITL", "--no-meshcat"]
        race += ["--lcm_url", DEFAULT_URL, "--no-report", "--track", args.track, "--laps", laps]
        race += ["--realtime_rate", args.realtime_rate, "--seed", args.seed, "--output", output]
        race += ["--scenario_text", text]
        if args.link_key:
            race += ["--link_key", args.link_key.absolute()]
        with open(Path(folder) / "log", "w+b") as log:
            process = subprocess.Popen([*map(str, race)], stdout=log, stderr=log)
            try:
                seconds = attacker.attack(process, args.rate)
            finally:
                process.terminate()
                code = process.wait()
            log.seek(0)
            said = log.read().decode(errors="replace")
        if not (output / "race.json").exists():
            raise UserError(f"The race could not be flown, exit code {code}: {said[-500:]}")
        result = json.loads((output / "race.json").read_text())
    return {"result": result, "laps": laps, "code": code, "sent": attacker.sent, "s": seconds}


class _Attacker:
    """Hears a race, and sends what it has heard with changes."""

    def __init__(self, seed: int):
        self._rng = random.Random(seed)
        self._heard: collections.deque[bytes] = collections.deque(maxlen=_KEPT)
        self.sent = 0

    def __enter__(self):
        self._ear, self._mouth = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
        self._ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._ear.bind(_GROUP)
        membership = socket.inet_aton(_GROUP[0]) + bytes(4)
        self._ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        self._ear.setblocking(False)
        self._own = None
        return self

    def __exit__(self, *_):
        self._ear.close()
        self._mouth.close()

    def attack(self, process: subprocess.Popen, rate: int) -> float:
        """Sends from the first command of the race to its end; returns how long that was (s)."""
        while process.poll() is None and not any(b"ROTOR_SPEED" in one for one in self._heard):
            self._hear()
            time.sleep(_PERIOD)
        start = time.monotonic()
        while process.poll() is None:
            due = int(rate * (time.monotonic() - start)) - self.sent
            for _ in range(min(due, rate)):
                spoilt = mutated_bytes(self._rng, self._rng.choice(self._heard))
                self._mouth.sendto(spoilt[:_MOST], _GROUP)
                self.sent += 1
            self._own = self._mouth.getsockname()[1]
            self._hear()
            time.sleep(_PERIOD)
        return time.monotonic() - start

    def _hear(self):
        try:
            while True:
                datagram, (_, port) = self._ear.recvfrom(LARGEST)
                if port != self._own:
                    self._heard.append(datagram)
        except BlockingIOError:
            return


def show(found: dict) -> tuple[list, bool]:
    """Returns the table of what each process has dropped, and whether the race was finished."""
    result, link = found["result"], found["result"]["wall"]["link"]
    rows = []
    for process in ("simulation", "pilot", "navigator"):
        counts = link if process == "simulation" else link.get(process, {})
        messages: collections.Counter[str] = collections.Counter()
        for channel in counts.get("channels", {}).values():
            messages.update(channel["dropped"])
        datagrams = counts.get("datagrams", {"received": 0, "dropped": {}})
        rows.append(
            {
                "process": process,
                "received": datagrams["received"],
                "datagrams": _counted(datagrams["dropped"]),
                "messages": _counted(messages),
            }
        )
    columns = {
        "process": "{process}",
        "datagrams": "{received}",
        "dropped datagrams": "{datagrams}",
        "dropped messages": "{messages}",
    }
    laps = len(result["laps"])
    rate = found["sent"] / max(found["s"], 1e-9)
    watchdog = link.get("watchdog", {})
    lines = [
        f"{found['sent']} mutated datagrams in {found['s']:.0f} s, {rate:.0f} a second",
        f"{laps} of {found['laps']} laps, {watchdog.get('holds')} holds, "
        f"{watchdog.get('hovers')} hovers, exit code {found['code']}",
        "It finished." if result["finished"] else f"It did not finish: {result['dnf_reason']}",
    ]
    return [harness.make_table("A race among mutated datagrams", rows, columns), *lines], bool(
        result["finished"]
    )


def _counted(dropped: dict) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items())) or "none"


if __name__ == "__main__":
    sys.exit(main())
