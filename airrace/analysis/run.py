"""A run: the folder that a race left, as tables."""

import importlib.util
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airrace.analysis.derived import derive, lap_starts
from airrace.analysis.log import is_complete, log_damage, read_attachments, read_log
from airrace.analysis.signals import read_signals, seconds
from airrace.common.errors import UserError
from airrace.common.resources import load_yaml
from airrace.recording.pictures import decoded
from airrace.recording.race_json import RaceJson, read_race_json
from airrace.recording.writer import FILE
from airrace.track import Track, load_track
from airrace.track.track_files import checked_track
from airrace.vehicle import Vehicle, load_vehicle
from airrace.vehicle.vehicle import checked_vehicle

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("csv", "parquet")


class Run:
    """A race that was flown.

    ``run.state`` is the table of that name, a pandas DataFrame; ``run.tables`` has
    them all:

    ============== ==================================================================
    state          the truth: position, quaternion w x y z, velocity, angular velocity,
                   roll, pitch, yaw, speed
    estimate       the same, as the autopilot hands it to the autonomy
    filtered       the same, as the controller uses it
    reference      what the controller follows: position, yaw, velocity, acceleration
    tracking       state minus reference, and its distance
    disturbance    acceleration that rotors and gravity do not explain
    imu            every sample that the log keeps of the IMU at the rate of states, in axes of
                   the body: angular velocity (rad/s), specific force (m/s^2)
    imu_samples    all samples of the IMU, only with ``--estimator vio``
    estimator      a row a picture, only with ``vio``: errors of attitude (in axes of the body),
                   position and velocity, their standard deviations, NEES per dimension, biases
    innovations    a row a picture and marker, only with ``vio``: normalised innovation squared
    rotors         a row a rotor and time: speed, command (rad/s), nominal thrust (N)
    detections     a row a marker and image: pose in the camera frame, range
    refused        what looked like a marker and was not taken for one, and why
    map            a row a marker and second: position, variance, observations, error
    gates          a row a gate and second, as the map has them
    plans          a row a plan: when it was made, for which lap, what it promises
    plan_gates     when a plan passes each gate, from gate 1 on
    plan_samples   its entry and its circuit, every 0.02 s
    events         what the explorer and the referee said
    crossings      a row a gate that counted
    laps           as in race.json; ``plan`` is the number of the plan that was flown, ``waited``
                   for how long (s) its clock waited for the drone
    ============== ==================================================================

    All is SI, in the world frame unless it says otherwise, angles in rad. ``lap`` is
    0 before gate 1 is crossed for the first time.

    Attributes:
        folder: of the run.
        result: race.json.
        scenario: the Scenario.
        track: the Track as it was when the race began.
        vehicle: the drone, as its file says.
        tables: all tables by name.
        recorded: whether there is a race.mcap; else most tables are empty.
        complete: whether it was closed; else its race was killed, or still goes on.
        damage: a sentence on what of race.mcap is damaged, or that it is missing; None if nothing
            is.
    """

    result: RaceJson

    def __init__(self, folder: str | Path, without: Iterable[str] = ()):
        """Reads a run. If its race.mcap is damaged, a line on standard error says so.

        Args:
            folder: of the race, or a file in it.
            without: topics of race.mcap to leave out, to save time.

        Raises:
            UserError: if it holds no race, or something of it cannot be read.
        """
        from airrace.scenario import load_scenario

        folder = Path(folder)
        self.folder = folder.parent if folder.is_file() else folder
        self.result = read_race_json(self.folder / "race.json")
        self.scenario = load_scenario(filename=str(self.folder / "scenario.yaml"))
        log = self.folder / FILE
        self.recorded = log.exists()
        # The log has what was raced, even if the files have changed or are elsewhere.
        files = read_attachments(log) if self.recorded else {}
        if "track.yaml" in files:
            track = load_yaml(Track, data=files["track.yaml"], what="the track")
            self.track = checked_track(track, f"in {log}")
        else:
            self.track = load_track(self.scenario.track, markers=True)
        if "vehicle.yaml" in files:
            vehicle = load_yaml(Vehicle, data=files["vehicle.yaml"], what="the drone")
            self.vehicle = checked_vehicle(vehicle, f"in {log}")
        else:
            self.vehicle = load_vehicle(self.scenario.drone)[0]
        self.complete = self.recorded and is_complete(log)
        self.damage = log_damage(log) if self.recorded else self._missing(log)
        if self.damage is not None:
            print(f"airrace: {self.damage}", file=sys.stderr)
        signals = read_signals(log if self.recorded else None, without)
        self.tables = derive(signals, self.result, self.track)

    def _missing(self, log: Path) -> str | None:
        if self.scenario.recording.content == "none":
            return None
        return f"{log} is missing: of this race, only what race.json says is left."

    def __getattr__(self, name: str) -> "pd.DataFrame":
        tables = self.__dict__.get("tables", {})
        if name in tables:
            return tables[name]
        raise AttributeError(f"A run has no '{name}'; its tables are: {', '.join(tables)}.")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.tables]

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r}, {len(self.result['laps'])} laps)"

    @property
    def lap_starts(self) -> np.ndarray:
        """When gate 1 was crossed, each of which starts a lap or ends the last (s)."""
        return lap_starts(self.tables["crossings"])

    def images(self) -> Iterator[tuple[float, np.ndarray]]:
        """Yields the time (s) and the grey levels, (h, w) uint8, of every recorded picture.

        Raises:
            UserError: if the race was not recorded.
        """
        for _, _, message in read_log(self.folder / FILE, ["/camera/image"]):
            if (picture := decoded(message.data)) is not None:
                yield seconds(message.timestamp), picture

    def export(self, folder: str | Path, format: str = "csv") -> list:
        """Writes every table to a file of its name; returns their paths.

        Args:
            folder: created if there is none.
            format: "csv" or "parquet".

        Raises:
            UserError: if they cannot be written.
        """
        if format not in FORMATS:
            raise UserError(f"The format must be one of {', '.join(FORMATS)}, not '{format}'.")
        if format == "parquet" and importlib.util.find_spec("pyarrow") is None:
            raise UserError(
                "Parquet needs pyarrow: pip install 'airrace[analysis]', or export as csv."
            )
        folder = Path(folder)
        paths = {name: folder / f"{name}.{format}" for name in self.tables}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name, table in self.tables.items():
                write = table.to_csv if format == "csv" else table.to_parquet
                write(paths[name], index=False)
        except OSError as e:
            raise UserError(
                f"{folder} cannot be written to ({e.strerror}); name another folder."
            ) from None
        return list(paths.values())


def load_run(folder: str | Path) -> Run:
    """Loads what a race left; see Run."""
    return Run(folder)
