"""What the mapping benchmark flies past and sees."""

import dataclasses as dc
import functools
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from airrace.math.random import make_generator
from airrace.rendering.imaging.camera_effects import ImagingChain
from airrace.rendering.planar.renderer import PlanarRenderer
from airrace.scenario import Scenario
from airrace.scenario.lap_limits import parse_limits
from airrace.systems.mapping.gate_mapper import extrapolate
from airrace.systems.mapping.image_mapper import ImageMapper, MapperState
from airrace.systems.perception.marker_measurement import DetectorConfig, measure
from airrace.systems.perception.marker_search import MarkerSearch
from airrace.systems.sensing.camera_view import CameraView
from airrace.systems.types import Detections
from airrace.track import load_track
from airrace.vehicle import CameraMount
from airrace.vehicle.camera_info import make_camera_info
from airrace.vehicle.state import as_state
from benchmarks import harness
from tests.worlds.kinematic_flight import Flight, filtered, fly_laps

# Ways to measure: corners and poses as airrace has them, or both by OpenCV alone.
CORNERS = {"refitted": DetectorConfig(), "OpenCV": DetectorConfig(corners="opencv", poses="marker")}
_OUTLIER_SIGMA = 3.0  # m, on each coordinate
_LEAST_OBSERVATIONS = 5  # of a marker that is judged


class Errors(NamedTuple):
    """What is wrong with what the mapper is given.

    Attributes:
        seed: of the noise of the state estimate, None for the true state.
        outliers: share of detections that are far off.
    """

    seed: int | None = None
    outliers: float = 0.0


@dc.dataclass(frozen=True)
class Frame:
    """One picture.

    Attributes:
        phase: 0 in the exploration, 1 in the laps.
        flight, time: which flight, and when on it (s).
        clock: time since the first picture (s).
        markers: what was measured in it: a key of CORNERS to a tuple of Detection.
    """

    phase: int
    flight: Flight
    time: float
    clock: float
    markers: dict


class World:
    """The track, the camera and the settings of a scenario."""

    def __init__(self, scenario: Scenario):
        """Args: scenario: whose track, camera and limits are used."""
        self.scenario = scenario
        self.track = load_track(scenario.track)
        self.boards = {board.id: board.X_WM for board in self.track.boards()}
        self.info = make_camera_info(
            width=scenario.camera.width,
            height=scenario.camera.height,
            fov_y=np.deg2rad(scenario.camera.fov_y_deg),
            X_BC=CameraMount().X_BC,
        )

    def frames(self, laps: int) -> list[Frame]:
        """Flies, takes pictures and measures the markers in them."""
        explorer = self.scenario.explorer
        flights = (
            fly_laps(self.track, 4, (explorer.max_speed, explorer.max_acceleration), 1),
            fly_laps(self.track, 6, parse_limits(self.scenario.planner.limits), laps),
        )
        times = [
            (phase, k / self.scenario.camera.fps)
            for phase, flight in enumerate(flights)
            for k in range(int(flight.duration * self.scenario.camera.fps))
        ]
        imaging = ImagingChain(
            effects=self.scenario.camera.resolved(), camera_info=self.info, seed=self.scenario.seed
        )
        renderer, detector = PlanarRenderer(self.track, imaging.pinhole), _Detector(self.info)
        image = np.empty((self.info.height, self.info.width), np.uint8)
        frames = []
        for k, (phase, time) in enumerate(harness.progress(times, "Taking pictures")):
            state = flights[phase].state(time)
            X_WB = extrapolate(state, 0.0)
            motion = as_state(state).angular_velocity, as_state(state).velocity
            imaging.picture(renderer.expose, X_WB, *motion, k).draw(image)
            markers = detector.detect(image)
            clock = time + phase * flights[0].duration
            frames.append(Frame(phase, flights[phase], time, clock, markers))
        return frames

    def map(self, frames, corners: str, estimator: str, errors: Errors) -> list:
        """Returns the figures of the map after the exploration and after the laps.

        Args:
            frames: from frames().
            corners: which of their markers.
            estimator: which of MAP_ESTIMATORS.
            errors: of poses and detections.
        """
        mapper = ImageMapper(dc.replace(self.scenario.perception, map_estimator=estimator))
        rng = make_generator(0, "outliers")
        state, injected, results = MapperState(), {}, []
        for frame, following in zip(frames, [*frames[1:], None]):
            markers = tuple(
                _grossly_wrong(m, rng, injected) if rng.random() < errors.outliers else m
                for m in frame.markers[corners]
            )
            X_WC = self._pose(frame.flight, frame.time, errors.seed) @ self.info.X_BC
            state = mapper.updated(state, Detections(frame.clock, markers), X_WC, self.info)
            if following is None or following.phase > frame.phase:
                results.append(self._figures(state.gate_map, injected))
        return results

    def _pose(self, flight, time, seed) -> RigidTransform:
        """Returns X_WB as the mapper has it: from the filtered estimate before."""
        if seed is None:
            return extrapolate(flight.state(time), 0.0)
        estimate = self._estimates(flight, seed)[
            int(time * self.scenario.state_estimate.rate + 1e-6)
        ]
        return extrapolate(estimate, time - as_state(estimate).time)

    @functools.cache  # noqa: B019  # the world lives as long as the benchmark
    def _estimates(self, flight, seed) -> np.ndarray:
        return filtered(flight, self.scenario.state_estimate, seed)

    def _figures(self, gate_map, injected) -> dict:
        errors, rejected, derived = [], [0.0], [0.0]
        for m in gate_map.markers:
            if m.id not in self.boards:
                continue
            error = float(np.linalg.norm(m.p_WM - self.boards[m.id].translation()))
            if m.count >= _LEAST_OBSERVATIONS:
                errors.append(error)
                wrongly = max(m.outliers - injected.get(m.id, 0), 0)
                rejected.append(wrongly / (m.count + wrongly))
            elif m.count == 0:
                derived.append(error)
        return {
            "markers": len(errors),
            "mean": float(np.mean(errors)),
            "worst": max(errors),
            "unseen": max(derived),
            "rejected": max(rejected),
            "refused": gate_map.refused,
        }


class _Detector:
    """Measures markers in pictures, in all ways."""

    def __init__(self, info):
        self._info = info
        self._searches = {
            name: MarkerSearch(refine=config.corners == "opencv")
            for name, config in CORNERS.items()
        }

    def detect(self, image) -> dict:
        """Returns tuples of Detection by a key of CORNERS; image: grey levels."""
        view = CameraView.of(image)
        return {
            name: measure(view, *self._searches[name].everywhere(image), self._info, config)[0]
            for name, config in CORNERS.items()
        }


def _grossly_wrong(marker, rng, injected):
    """Returns a detection moved far off, and counts it by its ID."""
    injected[marker.id] = injected.get(marker.id, 0) + 1
    p_CM = marker.X_CM.translation() + _OUTLIER_SIGMA * rng.standard_normal(3)
    return dc.replace(marker, X_CM=RigidTransform(marker.X_CM.rotation(), p_CM))
