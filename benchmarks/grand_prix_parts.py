"""The parts of benchmarks.grand_prix: each measures, and returns plain data."""

import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.processes import ONE_THREAD
from airrace.track.command import to_yaml
from airrace.track.generator import generate_square_track
from benchmarks import harness
from benchmarks.grand_prix_client import ARM, RESET, Client, Times, command, place
from benchmarks.grand_prix_noise import KINDS, NoisyClient
from benchmarks.grand_prix_simulation import Simulation, repeatable, serve
from benchmarks.peers import environments as env

ROOT = Path(__file__).parents[1]
MAVSDK = "mavsdk == 4.1.0"
_CLEAN = ("--quirks", "none")  # what flies at once, and has the signs of MAVLink
_QUIET_SECONDS = 2.0  # s, before the noise begins, with a margin
_IMU_RATE = 62.0  # Hz
_WARM = 60.0  # s of simulated time, after which memory must be flat
_SAMPLES = 10.0  # s of simulated time between two looks at the memory
_RESET_AFTER = 0.3  # s of simulated time
_FAREWELL = 10.0  # s, in which a client may end after its race
_OF_A_COURSE = ("gates", "gates_passed", "finished", "dnf_reason", "time_s", "max_speed")
_UNTIL_SAID = 30.0  # s, that a client may live on without a simulator


def rates(args) -> list:
    """Returns a row for each kind of message: its rate, and the one that the docs promise."""
    with tempfile.TemporaryDirectory() as folder, Client() as client:
        options = ("--step", "--vq", 1, "--record", "none", *_CLEAN)
        with Simulation(Path(folder), client.ports, *options, time_limit=args.rate_seconds) as sim:
            serve(sim, client)
        kinds = client.end().kinds
    return [
        {"kind": kind, "promised": rate, "count": times.count, "rate": times.rate}
        for kind, rate in promised_rates().items()
        for times in [kinds.get(kind, Times())]
    ]


def promised_rates() -> dict[str, float]:
    """Returns kind to rate (Hz), as the table of docs/grand_prix.md has it."""
    text = (ROOT / "docs" / "grand_prix.md").read_text(encoding="utf-8")
    table = text.partition("| to the client |")[2].partition("| from the client |")[0]
    found = {}
    for names, numbers in re.findall(r"(?m)^\| ([^|]+) \| ([\d., ]+) \|", table):
        kinds = [name.replace("`", "") for name in names.split(", ")]
        values = [float(number) for number in numbers.split(", ")]
        found |= dict(zip(kinds, values if len(values) > 1 else values * len(kinds)))
    return found


def soak(args) -> dict:
    """Returns what was sent and what came over minutes, and the memory meanwhile."""
    pace = ("--step",) if args.step else ("--realtime_rate", args.realtime_rate)
    memory: list = []
    with tempfile.TemporaryDirectory() as folder, Client() as client:
        options = (*pace, "--vq", 1, "--record", args.record, *_CLEAN)
        with Simulation(Path(folder), client.ports, *options, time_limit=args.seconds) as sim:

            def tick():
                if client.heard.time >= len(memory) * _SAMPLES:
                    memory.append([client.heard.time, sim.rss])

            serve(sim, client, tick)
            race = sim.result()
        heard, link = client.end(), race["wall"]["link"]
        recorded = sum(path.stat().st_size for path in Path(folder).rglob("*.mcap")) / 1e6
    later = [rss for at, rss in memory if at >= _WARM and rss == rss]
    return {
        "simulated_s": race["simulated_s"],
        "speed": race["simulated_s"] / race["wall"]["seconds"],
        "pace": " ".join(map(str, pace)),
        "end": race["dnf_reason"],
        "messages": [link["sent"], heard.messages, heard.gaps],
        "picture_datagrams": [link["picture_datagrams"], heard.datagrams],
        "pictures": [heard.pictures, heard.missing, heard.broken],
        "commands": [heard.sent, link["received"]],
        "unanswered": link["unanswered"],
        "rss_mb": [later[0], later[-1]] if later else [math.nan, math.nan],
        "record": args.record,
        "recorded_mb": recorded,
        "memory": memory,
    }


def malformed(args) -> dict:
    """Returns whether a race is the same beside bad datagrams, and what counted them."""
    steps = _IMU_RATE * max(args.noise_seconds - _QUIET_SECONDS, 1.0)
    per_step = math.ceil(args.datagrams / steps)
    races, hashes, counts, noise = [], [], {}, {}
    for datagrams in (0, args.datagrams):
        client = NoisyClient(datagrams, per_step, args.seed, hash_until=args.noise_seconds)
        with tempfile.TemporaryDirectory() as folder, client:
            options = ("--step", "--vq", 1, "--record", "none", "--seed", args.seed, *_CLEAN)
            limit = args.noise_seconds + 1.0
            with Simulation(Path(folder), client.ports, *options, time_limit=limit) as sim:
                serve(sim, client)
                race = sim.result()
        races.append(repeatable(race))
        hashes.append([each.hexdigest() for each in client.hashes])
        counts, noise = race["wall"]["link"], client.noise
    counters = {name for names in KINDS.values() for name in names}
    sent = sum(count for kind, count in noise.items() if KINDS[kind])
    return {
        "datagrams": sum(noise.values()),
        "noise": noise,
        "counts": {name: counts[name] for name in sorted(counters)},
        # A datagram of noise may end with what looks like the beginning of a message, or be that.
        "counted": sum(counts[name] for name in counters) > 0.9 * sent,
        "same_race": races[0] == races[1],
        "same_messages": hashes[0][0] == hashes[1][0],
        "same_pictures": hashes[0][1] == hashes[1][1],
        "hashes": hashes[1],
        "unanswered": counts["unanswered"],
    }


def courses(args) -> list:
    """Returns a row for each generated track that a client has flown, or not.

    Raises:
        UserError: if there is no such client.
    """
    if not args.client.is_file():
        raise UserError(f"--client: there is no program {args.client}; give the path of one.")
    seeds = range(args.seed, args.seed + args.tracks)
    flights = [(vq, seed) for vq in args.vq for seed in seeds]
    return [fly_course(args, *flight) for flight in harness.progress(flights, "Courses")]


def fly_course(args, vq: int, seed: int) -> dict:
    """Lets the client of --client fly the course of a seed, twice with --twice; returns a row.

    Courses of the first qualifier are nearly straight, those of the second wind.
    """
    track = generate_square_track(seed, None, straight=vq == 1)
    pace = ("--realtime_rate", args.courses_rate) if args.courses_rate else ("--step",)
    races, left = [], None
    for _ in range(2 if args.twice else 1):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "track.yaml").write_text(to_yaml(track, f"seed {seed}"))
            options = (*pace, "--vq", vq, "--quirks", args.quirks)
            race, words = _fly_client(args, folder, *options, "--track", folder / "track.yaml")
        races.append(race)
        left = left or words
    race = races[0]
    return {
        "vq": vq,
        "seed": seed,
        **{key: race[key] for key in _OF_A_COURSE},
        "collisions": sum(race["collisions"].values()),
        "client": left,
        "wall_s": race["wall"]["seconds"],
        "unanswered": race["wall"]["link"]["unanswered"],
        "same": repeatable(race) == repeatable(races[1]) if args.twice else None,
    }


def _fly_client(args, folder, *options):
    """Flies a race with the client of --client; returns race.json, and how the client failed."""
    ports = _free_ports()
    options += ("--record", "none")
    with (
        (folder / "client.txt").open("w") as words,
        Simulation(folder, ports, *options, time_limit=args.time_limit) as sim,
    ):
        client = [sys.executable, args.client.absolute()]
        client += ["--mavlink", ports[0], "--pictures", ports[1]]
        client = subprocess.Popen(
            list(map(str, client)),
            cwd=folder,
            env=os.environ | ONE_THREAD,
            stdin=subprocess.DEVNULL,
            stdout=words,
            stderr=subprocess.STDOUT,
        )
        try:
            _await_end(sim, client)
        finally:
            client.kill()
            code = client.wait()
        race = sim.result()
    if race["finished"] or code in (0, -9):
        return race, None
    last = (folder / "client.txt").read_text().splitlines()[-1:] or ["no words"]
    return race, f"client: exit code {code}, {last[0]}"


def _free_ports():
    """Returns two ports of loopback, for a client in a process of its own."""
    with Client() as client:
        return client.ports


def _await_end(sim, client):
    """Waits until the race is over; one whose client has ended is given up."""
    ended_at = None
    while sim.running:
        time.sleep(0.1)
        if client.poll() is not None:
            ended_at = ended_at or time.monotonic()
            if time.monotonic() > ended_at + _FAREWELL:
                sim.interrupt()
    limit = time.monotonic() + _FAREWELL
    while client.poll() is None and time.monotonic() < limit:
        time.sleep(0.1)


class Resetter(Client):
    """Arms, flies a moment, resets, and so on.

    Attributes:
        resets: how many have been carried out.
    """

    def __init__(self):
        super().__init__()
        self.resets, self._before, self._asked, self._steps = 0, 0.0, False, 0

    def reply(self, number: int) -> None:
        if self.heard.time < self._before:
            self.resets, self._asked, self._steps = self.resets + 1, False, 0
        self._before, self._steps = self.heard.time, self._steps + 1
        message = command(ARM, 1.0) if self._steps == 5 else place(0.0, 0.0, -2.0)
        if self.heard.time > _RESET_AFTER and not self._asked:
            self._asked, message = True, command(RESET)
        self.send(self.pack(message))


def reset(args) -> list:
    """Returns the memory after so many resets, as rows."""
    wanted = sorted({0, 1, min(10, args.resets), args.resets // 2, args.resets})
    rows: list = []
    with tempfile.TemporaryDirectory() as folder, Resetter() as client:
        options = ("--step", "--record", args.record, "--runs", 1, *_CLEAN)
        with Simulation(Path(folder), client.ports, *options) as sim:

            def tick():
                while len(rows) < len(wanted) and client.resets >= wanted[len(rows)]:
                    if client.heard.time == 0.0:
                        return False
                    rows.append({"resets": client.resets, "rss_mb": sim.rss})
                return len(rows) == len(wanted)

            serve(sim, client, tick)
    return rows


def mavsdk(args) -> dict:
    """Returns what MAVSDK did, and what the simulator says of it.

    Raises:
        PeerError: if it is not installed.
    """
    folder = args.folder.absolute()
    if args.install:
        env.install(folder, "mavsdk", MAVSDK)
    python = env.python_of(folder, "mavsdk", MAVSDK)
    ports = _free_ports()
    with tempfile.TemporaryDirectory() as name:
        options = ("--vq", 1, "--record", "none", *_CLEAN)
        with Simulation(Path(name), ports, *options, time_limit=1e6) as sim:
            done = subprocess.run(
                [python, str(Path(__file__).parent / "grand_prix_mavsdk.py"), str(ports[0])],
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
                timeout=_UNTIL_SAID + 300.0,
            )
            sim.interrupt()
            race = sim.result()
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    steps = json.loads(lines[-1]) if lines else {"connects": False, "said": done.stderr[-500:]}
    return {"steps": steps, "started": race["start_s"] is not None, "link": race["wall"]["link"]}
