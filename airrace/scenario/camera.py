"""The camera's part of a scenario."""

import dataclasses as dc
import math

from airrace.common.errors import UserError
from airrace.rendering.imaging.camera_effects import CameraEffects

RENDERERS = ("planar", "vtk")  # or NO_CAMERA, where the map is given
NO_CAMERA = "none"
PRESETS = {
    # Ideal pictures, at once.
    "clean": CameraEffects(),
    # A good industrial camera in daylight, rectified like the reference's.
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
    gain: float | None = None
    vignetting: float | None = None  # share of the light lost in the corners
    read_noise: float | None = None  # grey levels
    shot_noise: float | None = None  # variance per grey level
    distortion: list[float] | None = None  # k1, k2, p1, p2, k3
    latency: float | None = None  # s, from mid exposure to the picture


@dc.dataclass
class CameraConfig:
    """The drone's camera."""

    renderer: str = "planar"  # or "vtk"
    width: int = 1280
    height: int = 720
    fov_y_deg: float = 55.95
    fps: float = 30.0
    preset: str = "realistic"  # or "clean", "harsh"
    effects: EffectsConfig = dc.field(default_factory=EffectsConfig)

    def resolved(self) -> CameraEffects:
        """Returns the preset with what takes its place."""
        given = {k: v for k, v in vars(self.effects).items() if v is not None}
        if "distortion" in given:
            given["distortion"] = tuple(map(float, given["distortion"]))
        return dc.replace(PRESETS[self.preset], **given)

    def check(self) -> None:
        """Raises UserError on a bad combination of values."""
        for name, choices in (("renderer", (*RENDERERS, NO_CAMERA)), ("preset", tuple(PRESETS))):
            value = getattr(self, name)
            if value not in choices:
                raise UserError(
                    f"camera.{name} must be one of {', '.join(choices)}, not '{value}'."
                )
        effects = self.resolved()
        if len(effects.distortion) != 5 or not all(map(math.isfinite, effects.distortion)):
            raise UserError(
                "camera.effects.distortion must be five finite numbers, [k1, k2, p1, p2, k3]."
            )
        for name in ("shutter", "latency"):
            if getattr(effects, name) >= 1.0 / self.fps:
                raise UserError(
                    f"camera.effects.{name} must be shorter than one frame, 1 / camera.fps; "
                    f"it is {getattr(effects, name)} s."
                )


# Least and greatest value, for the scenario's check of all numbers.
RANGES = {
    "camera.width": (16, 8192),
    "camera.height": (16, 8192),
    "camera.fov_y_deg": (1, 170),
    "camera.fps": (1, 1000),
    "camera.effects.shutter": (0, 1),
    "camera.effects.gain": (0.05, 10),
    "camera.effects.vignetting": (0, 1),
    "camera.effects.read_noise": (0, 50),
    "camera.effects.shot_noise": (0, 10),
    "camera.effects.latency": (0, 1),
    "camera.effects.distortion[]": (-10, 10),
}
