"""The race on the terminal: live progress, then a table of laps."""

import contextlib
import os
import time

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from airrace.diagrams.results import RaceRecord

# Mean laps of the original system on its own track (s).
ORIGINAL_MEAN_LAP = {"3": 40.60, "4": 41.52, "6": 41.21}
_REFRESH = 0.1  # s


class _PatientConsole(Console):
    """A console whose reader may leave (| head): the race goes on, for its files."""

    def on_broken_pipe(self):
        _go_quiet(self)


def _go_quiet(console: Console):
    """Prints nothing from now on, not even what Python still holds back."""
    console.quiet = True
    with contextlib.suppress(OSError), open(os.devnull, "w") as devnull:
        os.dup2(devnull.fileno(), console.file.fileno())


class RaceDisplay:
    """Shows a race while it runs; its `show` is a callback of run_race()."""

    def __init__(self, scenario, track, meshcat=None, console: Console | None = None):
        """Constructs the display; nothing is printed before the first show().

        Args:
            scenario, track: of the race.
            meshcat: whose address to show, or None.
            console: to write to; standard output by default.
        """
        self._scenario = scenario
        self._track_name = track.name
        self._gates = len(track.gates)
        self._meshcat = meshcat
        self._console = console or _PatientConsole()
        self._start = self._last = time.perf_counter()
        self._state = None
        self._live = None

    def close(self):
        """Ends the live display."""
        if self._live is not None:
            with self._patience():
                self._live.stop()

    def show(self, record: RaceRecord, look):
        """Shows the race at a look; see run_race()."""
        with self._patience():
            if self._state is None:
                self._open()
            self._show(record, look)

    @contextlib.contextmanager
    def _patience(self):
        """Gives up printing, not the race, when printing fails (disk full)."""
        try:
            yield
        except OSError:
            self._live = None
            _go_quiet(self._console)

    def _open(self):
        scenario = self._scenario
        self._print(f"airrace: {scenario.drone} on {self._track_name}, {scenario.trajectory}-D, "
                    f"seed {scenario.seed}, {scenario.laps} laps")
        if self._meshcat is not None:
            self._print(f"Watch it at {self._meshcat.web_url()}")
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()

    def _print(self, line: str):
        """Prints a line as it is: names and paths may look like markup."""
        self._console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)

    def _show(self, record, look):
        status = record.status
        if (status.state, status.since) != self._state:
            self._state = (status.state, status.since)
            self._print(f"[{status.since:7.1f} s] {status.state}: {status.reason}")
        for lap in range(record.laps_flown - look.laps_ended, record.laps_flown):
            first, last = (record.report.crossings[self._gates * k].time for k in (lap, lap + 1))
            self._print(f"[{last:7.1f} s] lap {lap + 1}: {last - first:.2f} s")
        now = time.perf_counter()
        if self._live is not None and now - self._last > _REFRESH:
            self._last = now
            self._live.update(Text(self._line(record, look, now)), refresh=True)

    def _line(self, record, look, now) -> str:
        rate = look.time / (now - self._start)
        clock = f"{look.time:6.1f} s simulated, {rate:.1f} x real time"
        if not record.status.done:
            return f"exploring  {len(record.status.gates)} gates found   {clock}"
        crossings = len(record.report.crossings)
        lap = min(max(crossings - 1, 0) // self._gates + 1, self._scenario.laps)
        flown = max(crossings - 1, 0)
        total = self._scenario.laps * self._gates
        bar = "#" * (30 * flown // total)
        gate = crossings % self._gates + 1
        return f"racing [{bar:30}] lap {lap}/{self._scenario.laps}, next gate {gate}   {clock}"

    def print_summary(self, result: dict, output_dir):
        """Prints the table of laps and where the results are."""
        if result["finished"]:
            mean = result["mean_lap_s"]
            line = f"Finished: mean lap {mean:.2f} s, best {result['best_lap_s']:.2f} s"
            if result["track"] == "student-airrace":
                original = ORIGINAL_MEAN_LAP[result["trajectory"]]
                line += f" (the original system: mean {original:.2f} s)"
        else:
            line = f"Did not finish: {result['dnf_reason']}"
        wall = result["wall"]
        with self._patience():
            if result["laps"]:
                self._console.print(lap_table(result))
            self._print(f"{line}; {wall['seconds']:.0f} s of work, "
                        f"{wall['real_time_factor']:.1f} x real time.")
            self._print(f"Results: {output_dir}")


def lap_table(result: dict) -> Table:
    """Returns the table of laps of a race.json."""
    table = Table()
    for heading in ("lap", "time (s)", "planned (s)", "max speed (m/s)",
                    "worst gate offset (m)", "map RMS (m)"):
        table.add_column(heading, justify="right")
    for lap in result["laps"]:
        plan = lap["plan"]
        table.add_row(
            str(lap["lap"]),
            f"{lap['time_s']:.2f}",
            f"{plan['duration_s']:.2f}" if plan else "-",
            f"{lap['max_speed']:.1f}",
            f"{max(lap['gate_offsets_m']):.2f}",
            f"{lap['map_rms_m']:.3f}" if lap["map_rms_m"] is not None else "-",
        )
    return table
