"""The race on the terminal: live progress, then a table of laps."""

import time

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from airrace.diagrams.results import RaceRecord

# Mean laps of the original system on its own track (s).
ORIGINAL_MEAN_LAP = {"3": 40.60, "4": 41.52, "6": 41.21}
_REFRESH = 0.1  # s


class RaceDisplay:
    """Shows a race while it runs; its `show` is a callback of run_race()."""

    def __init__(self, scenario, track, meshcat=None, console: Console | None = None):
        """Starts the display.

        Args:
            scenario, track: of the race.
            meshcat: whose address to show, or None.
            console: to write to; standard output by default.
        """
        self._scenario = scenario
        self._gates = len(track.gates)
        self._console = console or Console()
        self._start = self._last = time.perf_counter()
        self._state = None
        title = f"airrace: {scenario.drone} on {track.name}, {scenario.trajectory}-D, "
        self._console.print(f"{title}seed {scenario.seed}, {scenario.laps} laps")
        if meshcat is not None:
            self._console.print(f"Watch it at {meshcat.web_url()}")
        self._live = None
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()

    def close(self):
        """Ends the live display."""
        if self._live is not None:
            self._live.stop()

    def show(self, record: RaceRecord, look):
        """Shows the race at a look; see run_race()."""
        status = record.status
        if (status.state, status.since) != self._state:
            self._state = (status.state, status.since)
            self._console.print(
                f"[{status.since:7.1f} s] {status.state}: {status.reason}", highlight=False,
                markup=False,
            )
        for lap in range(record.laps_flown - look.laps_ended, record.laps_flown):
            first, last = (record.report.crossings[self._gates * k].time for k in (lap, lap + 1))
            self._console.print(
                f"[{last:7.1f} s] lap {lap + 1}: {last - first:.2f} s", highlight=False,
                markup=False,
            )
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
        if result["laps"]:
            self._console.print(lap_table(result))
        if result["finished"]:
            mean = result["mean_lap_s"]
            line = f"Finished: mean lap {mean:.2f} s, best {result['best_lap_s']:.2f} s"
            if result["track"] == "student-airrace":
                original = ORIGINAL_MEAN_LAP[result["trajectory"]]
                line += f" (the original system: mean {original:.2f} s)"
        else:
            line = f"Did not finish: {result['dnf_reason']}"
        wall = result["wall"]
        self._console.print(
            f"{line}; {wall['seconds']:.0f} s of work, "
            f"{wall['real_time_factor']:.1f} x real time.", highlight=False,
        )
        self._console.print(f"Results: {output_dir}", highlight=False, soft_wrap=True)


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
