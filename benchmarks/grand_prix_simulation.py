"""The simulator of benchmarks.grand_prix: `airrace grand-prix` in a process of its own."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from airrace.common.errors import UserError
from airrace.common.processes import ONE_THREAD
from benchmarks.grand_prix_client import Client

_PATIENCE = 300.0  # s without a word, after which something is wrong; to compile takes its time
_END = 60.0  # s, in which it ends after Ctrl-C


class Simulation:
    """A race that waits for a client at two ports of loopback.

    Attributes:
        log: file of what it prints.
    """

    def __init__(self, folder: Path, ports, *options: object, time_limit: float = 480.0):
        """Starts it.

        Args:
            folder: an existing one, for its results.
            ports: of the client: for MAVLink and for pictures.
            options: more of the command.
            time_limit: of the race, from arming (s).
        """
        self._race, self.log = folder / "race", folder / "log.txt"
        text = f"{{mavlink: {{time_limit: {time_limit}}}}}"
        words = [sys.executable, "-m", "airrace", "grand-prix", "--no-meshcat"]
        words += ["--client", f"127.0.0.1:{ports[0]}", "--picture_port", ports[1]]
        words += ["--output", self._race, "--scenario_text", text, *options]
        with self.log.open("w") as log:
            self._process = subprocess.Popen(
                list(map(str, words)),
                env=os.environ | ONE_THREAD,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.running:
            self._process.kill()
        self._process.wait()

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    @property
    def rss(self) -> float:
        """Its memory (MB), NaN if it has ended."""
        try:
            lines = Path(f"/proc/{self._process.pid}/status").read_text().splitlines()
        except OSError:
            lines = []
        sizes = [line.split()[1] for line in lines if line.startswith("VmRSS")]
        return int(sizes[0]) * 1024 / 1e6 if sizes else float("nan")

    @property
    def cpu_seconds(self) -> float:
        """Its processor time so far (s), NaN if it has ended."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return float("nan")
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def interrupt(self) -> None:
        """Ends it as Ctrl-C does."""
        if self.running:
            self._process.send_signal(signal.SIGINT)
            self._process.wait(_END)

    def result(self) -> dict:
        """Returns its race.json.

        Raises:
            UserError: with its last words, if it left none.
        """
        try:
            return json.loads((self._race / "race.json").read_text())
        except (OSError, json.JSONDecodeError):
            words = self.log.read_text().splitlines() or ["no words"]
            raise UserError(f"The simulator left no result: {words[-1]}") from None


def serve(simulation: Simulation, client: Client, tick=lambda: False) -> None:
    """Lets a client hear and answer until the simulation ends.

    Args:
        simulation, client: both sides.
        tick: is called again and again; once it returns True, the simulation is ended.

    Raises:
        UserError: if nothing comes for minutes.
    """
    heard_at = time.monotonic()
    while simulation.running:
        if client.listen(0.2):
            heard_at = time.monotonic()
        elif time.monotonic() > heard_at + _PATIENCE:
            raise UserError(f"Nothing has come for {_PATIENCE:.0f} s.")
        if tick():
            simulation.interrupt()
    while client.listen(0.2):  # what still waits
        pass


def repeatable(race: dict) -> dict:
    """Returns of a race.json what must be the same each time: all but clocks and counters."""
    return {key: value for key, value in race.items() if key != "wall"}
