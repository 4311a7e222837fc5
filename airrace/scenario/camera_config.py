"""The camera's part of a scenario."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from airrace.rendering.imaging.camera_effects import CameraEffects
from airrace.vehicle.camera_info import CameraInfo, make_camera_info

RENDERERS = ("planar", "vtk")  # or NO_CAMERA, where the map is given
NO_CAMERA = "none"
PRESETS = {
    # Ideal pictures, at once.
    "clean": CameraEffects(),
    # A good industrial camera in daylight, rectified like the original's.
    "realistic": CameraEffects(
        shutter=0.004, vignetting=0.2, read_noise=1.0, shot_noise=0.02, latency=0.010
    ),
    # A cheap one at dusk, behind a wide-angle lens.
    "harsh": CameraEffects(
        shutter=0.010,
        gain=0.8,
        vignetting=0.5,
        read_noise=4.0,
        shot_noise=0.15,
        distortion=(-0.25, 0.08, 0.001, -0.001, 0.0),
        latency=0.020,
    ),
}


@dc.dataclass
class EffectsConfig:
    """Takes the place of what the preset says; see CameraEffects."""

    shutter: float | None = None  # s
    gain: float | None = None  # of the brightness
    vignetting: float | None = None  # share of the light lost in the corners
    read_noise: float | None = None  # grey levels
    shot_noise: float | None = None  # variance per grey level
    distortion: list[float] | None = None  # k1, k2, p1, p2, k3
    latency: float | None = None  # s, from mid exposure to the picture


@dc.dataclass
class CameraConfig:
    """The drone's camera."""

    renderer: str = "planar"  # or "vtk"; or "none", with a map
    width: int = 1280  # px
    height: int = 720  # px
    fov_y_deg: float = 55.95  # from the top to the bottom of the picture
    fps: float = 30.0  # pictures a second
    preset: str = "realistic"  # or "clean", "harsh"
    effects: EffectsConfig = dc.field(default_factory=EffectsConfig)

    def info(self, X_BC: RigidTransform) -> CameraInfo:
        """Returns the calibration; X_BC: pose of the camera in the body."""
        return make_camera_info(
            width=self.width,
            height=self.height,
            fov_y=np.deg2rad(self.fov_y_deg),
            X_BC=X_BC,
            D=self.resolved().distortion,
        )

    def resolved(self) -> CameraEffects:
        """Returns the preset with what takes its place."""
        given = {k: v for k, v in vars(self.effects).items() if v is not None}
        if "distortion" in given:
            given["distortion"] = tuple(map(float, given["distortion"]))
        return dc.replace(PRESETS[self.preset], **given)
