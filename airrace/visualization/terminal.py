"""The race on the terminal: live progress, then a table of laps."""

import contextlib
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Column, Table

from airrace.common.words import count, printable
from airrace.math.quaternion import rotation_matrix
from airrace.recording import race_events as events
from airrace.recording.flown_plans import plan_of_laps, same_plan_words
from airrace.recording.race_result import ORIGINAL_LAPS, ORIGINAL_TRACK, own_systems_words
from airrace.scenario import Scenario, laps_name
from airrace.systems.types import ExplorerStatus
from airrace.track import Track
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.rotor_loss import Remaining

_REFRESH = 0.1  # s
# Above this, the plant's steps of 1 ms lose about a hundredth of the angular momentum a second.
_TUMBLING = 15.0  # rad/s
_UPRIGHT = 0.5  # cosine of a lean, of which the drone turns over
_TAKING_OFF = 3.0  # s
_LATE = 1.0  # s, behind the real time, that is no news
_WAITED = 0.005  # s, in a lap, that are told
_CAPTION = (
    "over bound: how much longer the planned lap is than the best lap of a point mass with the "
    "same limits and no drag; map error: RMS over the markers"
)


class _PatientConsole(Console):
    """A console whose reader may leave (| head) without an end of the program."""

    def on_broken_pipe(self):
        raise  # what rich has caught


class RaceDisplay:
    """A sink that shows a race while it runs, then prints its table of laps."""

    def __init__(
        self,
        scenario: Scenario,
        track: Track,
        addresses: Sequence[str] = (),
        console: Console | None = None,
    ):
        """Constructs the display; nothing is printed before the first event.

        Args:
            scenario, track: of the race.
            addresses: lines that say where the race can be watched.
            console: to write to; standard output by default.
        """
        self._scenario = scenario
        self._track_name = track.name
        self._gates = len(track.gates)
        self._half_width = min(gate.pylon_spacing for gate in track.gates) / 2
        self._addresses = addresses
        self._console = console or _PatientConsole()
        self._start = self._last = time.perf_counter()
        self._vehicle = load_vehicle(scenario.drone)[0]
        self._opened, self._explorer = False, ExplorerStatus()
        self._lost, self._crossings = list[int](), 0
        self._tumbled = self._pulled = self._over = False
        self._took_off = np.inf  # s
        self._lap_start = 0.0  # s
        self._delay = self._lap_delay = 0.0  # of plans, and at the start of the lap (s)
        self._live: Progress | None = None

    def announce(self, what: str) -> None:
        """Shows what is being done next, which takes a second or two."""
        with self._patience():
            if self._live is not None:
                self._live.update(
                    self._live.task_ids[0], description=f"{what} ...", total=None, clock=""
                )
                self._live.refresh()

    def close(self) -> None:
        """Ends the live display."""
        if self._live is not None:
            with self._patience():
                self._live.stop()

    def take(self, event: events.RaceEvent) -> None:
        """Shows what has happened."""
        with self._patience():
            if not self._opened:
                self._opened = True
                self._open()
            self._take(event)

    @contextlib.contextmanager
    def _patience(self) -> Iterator[None]:
        """Gives up printing, not the race, when printing fails (a closed pipe, a full disk)."""
        try:
            yield
        except OSError:
            self._live, self._console.quiet = None, True
            # Not even what Python still holds back.
            with contextlib.suppress(OSError), open(os.devnull, "w") as devnull:
                os.dup2(devnull.fileno(), self._console.file.fileno())

    def note(self, line: str) -> None:
        """Prints a line that is not about the race itself."""
        with self._patience():
            self._print(line)

    def _open(self) -> None:
        scenario = self._scenario
        kind = laps_name(scenario.trajectory, scenario.planner.limits)
        self._print(
            f"airrace: {self._vehicle.name} on {self._track_name}, {kind}, "
            f"seed {scenario.seed}, {count(scenario.laps, 'lap')}"
        )
        if scenario.systems:
            self._print(f"Your own: {own_systems_words(scenario.systems)}")
        for line in self._addresses:
            self._print(line)
        if self._console.is_terminal:
            self._live = Progress(
                TextColumn("{task.description}"),
                BarColumn(bar_width=20),
                TextColumn("{task.fields[clock]}"),
                console=self._console,
                auto_refresh=False,
                transient=True,
            )
            self._live.add_task("", total=None, clock="")
            self._live.start()

    def _print(self, line: str) -> None:
        """Prints a line as it is: names and paths may look like markup."""
        self._console.print(
            printable(line), highlight=False, markup=False, emoji=False, soft_wrap=True
        )

    def _take(self, event: events.RaceEvent) -> None:
        match event:
            case events.ExplorerChanged():
                self._explorer = event.status
                for each in event.entered:
                    self._print_at(each.time, f"{each.state}: {each.reason}")
                    if each.state == "TAKE_OFF":
                        self._took_off = each.time
            case events.PolicyChanged():
                self._print_at(event.status.since, event.what)
            case events.RotorLost():
                self._lost.append(event.rotor)
                self._print_at(event.noticed, loss_line(self._vehicle, self._lost))
            case events.NegativeThrusts() if not self._pulled:
                self._pulled = True
                self._print_at(
                    event.time,
                    "the controller asks for a negative thrust, which counts as none: rotors "
                    "only push, up along the body's z axis",
                )
            case events.ClockWaits():
                self._delay = event.delay
            case events.GateCrossed():
                crossing = event.crossing
                if crossing.gate == 1 and self._crossings:
                    lap, waited = self._crossings // self._gates, self._delay - self._lap_delay
                    told = waited >= _WAITED
                    words = f", in which the clock waited {waited:.2f} s" if told else ""
                    self._print_at(
                        crossing.time, f"lap {lap}: {crossing.time - self._lap_start:.2f} s{words}"
                    )
                if crossing.gate == 1:
                    self._lap_start, self._lap_delay = crossing.time, self._delay
                self._crossings += 1
            case events.StateSample():
                self._warn_of_wrong_moments(event)
                self._warn_of_tumbling(event)
                self._refresh(event.time)

    def _warn_of_tumbling(self, sample: events.StateSample) -> None:
        rate = np.linalg.norm(sample.truth.angular_velocity)
        if rate > _TUMBLING and not self._tumbled:
            self._tumbled = True
            self._print_at(
                sample.time,
                f"it turns at {rate:.0f} rad/s, for which the plant's steps are too long to be "
                "exact: see plant_config in docs/drake.md",
            )

    def _warn_of_wrong_moments(self, sample: events.StateSample) -> None:
        """Says what it looks like if a controller of one's own turns the drone over at take-off."""
        after = sample.time - self._took_off
        is_own = "geometric_controller" in self._scenario.systems and not self._lost
        if self._over or not is_own or not 0.0 < after < _TAKING_OFF:
            return
        x, y, z = rotation_matrix(sample.truth.quaternion)[2]  # up, in the body's axes
        if z < _UPRIGHT:
            self._over = self._tumbled = True  # one line is enough
            axis = "x" if abs(y) > abs(x) else "y"
            self._print_at(
                sample.time,
                f"it turns over about its {axis} axis, {after:.1f} s after take-off: moments of "
                "the wrong sign about that axis do this, see docs/own_systems.md",
            )

    def _print_at(self, time: float, line: str) -> None:
        self._print(f"[{time:7.1f} s] {line}")

    def _refresh(self, time_s: float) -> None:
        now = time.perf_counter()
        if self._live is not None and now - self._last > _REFRESH:
            self._last = now
            self._live.update(self._live.task_ids[0], **self._progress(time_s, now))
            self._live.refresh()

    def _progress(self, time_s: float, now: float) -> dict:
        """Returns what the bar shows; while exploring, nobody knows how long it will take."""
        clock = f"{time_s:.1f} s simulated, {time_s / (now - self._start):.1f} x real time"
        if not self._explorer.done:
            found = count(len(self._explorer.gates), "gate")
            return dict(description=f"exploring, {found} found", total=None, clock=clock)
        crossings, gates, laps = self._crossings, self._gates, self._scenario.laps
        lap = min(max(crossings - 1, 0) // gates + 1, laps)
        return dict(
            description=f"lap {lap}/{laps}, next gate {crossings % gates + 1}",
            total=laps * gates,
            completed=max(crossings - 1, 0),
            clock=clock,
        )

    def print_summary(self, result: dict, output_dir: Path) -> None:
        """Prints the table of laps and where the results are."""
        if result["finished"]:
            mean = result["mean_lap_s"]
            line = f"Finished: mean lap {mean:.2f} s, best {result['best_lap_s']:.2f} s"
            if (result["track"], result["limits"]) == (ORIGINAL_TRACK, "original"):
                # Three dimensions were the nearest to an optimal lap that it had.
                original = ORIGINAL_LAPS.get(result["trajectory"], ORIGINAL_LAPS["3"])
                line += f" (the original system, from rest to rest: mean {original:.2f} s)"
        else:
            line = f"Did not finish: {result['dnf_reason']}"
        wall = result["wall"]
        with self._patience():
            if result["laps"]:
                self._console.print(lap_table(result, self._half_width))
            for sentence in (same_plan_words(plan_of_laps(result["laps"])), failures_line(result)):
                if sentence:
                    self._print(sentence)
            self._print(
                f"{line}; {wall['seconds']:.0f} s to simulate, "
                f"{wall['real_time_factor']:.1f} x real time."
            )
            if (late := wall.get("link", {}).get("late_s", 0.0)) > _LATE:
                self._print(
                    f"This computer was too slow for real time by {late:.0f} s, in which the drone "
                    "saw less than it should: race with --realtime_rate 0.5, or with --lockstep."
                )
            self._print(f"Results: {output_dir}")


def lap_table(result: dict, half_width: float) -> Table:
    """Returns the table of laps of a race.json.

    Args:
        result: of the race.
        half_width: from the middle of a gate to its pylons (m).
    """
    headings = (
        "lap,time (s),planned (s),over bound,max speed (m/s),"
        f"worst gate offset (m); pylons at {half_width:g},map error (cm)"
    )
    table = Table(
        *(Column(heading, justify="right") for heading in headings.split(",")),
        caption=_CAPTION,
        caption_justify="left",
    )
    for lap in result["laps"]:
        plan = lap["plan"]
        mark = " *" if _failures_in(result, lap["start_s"], _end(lap)) else ""
        table.add_row(
            f"{lap['lap']}{mark}",
            f"{lap['time_s']:.2f}",
            f"{plan['duration_s']:.2f}" if plan else "-",
            f"{plan['over_bound']:.1%}" if plan and plan.get("over_bound") is not None else "-",
            f"{lap['max_speed']:.1f}",
            f"{max(lap['gate_offsets_m']):.2f}",
            f"{100 * lap['map_rms_m']:.2f}" if lap["map_rms_m"] is not None else "-",
        )
    return table


def loss_line(vehicle: Vehicle, lost: Sequence[int]) -> str:
    """Returns what the autonomy makes of lost rotors, given by their numbers, the newest last."""
    n = len(vehicle.rotors)
    if Remaining(vehicle, [i + 1 not in lost for i in range(n)]).can_fly:
        return f"rotor {lost[-1]} lost: flying on with the other {n - len(lost)}"
    return f"rotor {lost[-1]} lost: the others cannot hold the yaw, coming down"


def failures_line(result: dict) -> str:
    """Returns what failing rotors did to the laps of a race.json; empty if nothing."""
    laps = result["laps"]
    failures = _failures_in(result, 0.0, _end(laps[-1])) if laps else []
    if not failures:
        return ""
    times = [failure["time_s"] for failure in failures]
    before = _mean_time(lap for lap in laps if _end(lap) <= min(times))
    after = _mean_time(lap for lap in laps if lap["start_s"] > max(times))
    what = ", ".join(f"rotor {f['rotor']} failed at {f['time_s']:.1f} s" for f in failures)
    return f"* {what}: mean lap {before} before, {after} after."


def _failures_in(result: dict, start: float, end: float) -> list:
    """Returns the rotor failures from start to before end (s), in order."""
    failures = [f for f in result["rotor_failures"] if start <= f["time_s"] < end]
    return sorted(failures, key=lambda failure: failure["time_s"])


def _end(lap: dict) -> float:
    return lap["start_s"] + lap["time_s"]


def _mean_time(laps: Iterable[dict]) -> str:
    times = [lap["time_s"] for lap in laps]
    return f"{sum(times) / len(times):.2f} s" if times else "-"
