"""From ideal pictures to a camera's: shutter, lens and sensor in a row."""

import dataclasses as dc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from airrace.rendering.images import as_boxes
from airrace.rendering.imaging.lens import Lens
from airrace.rendering.imaging.motion_blur import MeanPicture, Shutter
from airrace.rendering.imaging.sensor import Sensor

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

    from airrace.rendering.planar.renderer import Exposure
    from airrace.vehicle.camera_info import CameraInfo


@dc.dataclass(frozen=True)
class CameraEffects:
    """What a real camera adds to an ideal picture; the defaults add nothing."""

    shutter: float = 0.0  #: how long it is open (s)
    #: gain, vignetting, read_noise, shot_noise: see Sensor
    gain: float = 1.0
    vignetting: float = 0.0
    read_noise: float = 0.0
    shot_noise: float = 0.0
    distortion: tuple = (0.0, 0.0, 0.0, 0.0, 0.0)  #: plumb-bob k1, k2, p1, p2, k3
    latency: float = 0.0  #: from the middle of the exposure to the picture (s)


class ImagingChain:
    """Takes a picture with any renderer, as a real camera would.

    Brightness is taken as proportional to grey levels, as in a raw picture.

    Attributes:
        pinhole: CameraInfo of the pictures that the renderer must draw.
    """

    def __init__(self, *, effects: CameraEffects, camera_info: "CameraInfo", seed: int):
        """Constructs the chain; raises UserError if the lens is impossible.

        Args:
            effects: what to add; the latency is not of a picture, and the distortion is that of
                camera_info.
            camera_info: of the camera's pictures.
            seed: of the noise, >= 0.
        """
        self._lens = Lens(camera_info) if np.any(camera_info.D) else None
        self.pinhole = camera_info if self._lens is None else self._lens.pinhole
        self._shutter = Shutter(time=effects.shutter, camera_info=self.pinhole)
        self._sensor = Sensor(
            camera_info=camera_info,
            gain=effects.gain,
            vignetting=effects.vignetting,
            read_noise=effects.read_noise,
            shot_noise=effects.shot_noise,
            seed=seed,
        )

    def picture(
        self,
        expose: Callable,
        X_WB: "RigidTransform",
        w_WB: np.ndarray,
        v_WB: np.ndarray,
        frame: int,
        seed: int | None = None,
    ) -> "MeanPicture | Exposure | _TakenPicture":
        """Returns a picture to be drawn, perhaps piece by piece.

        Args:
            expose: returns the mean of ideal pictures, such as PlanarRenderer.expose();
                called with weighted poses of the camera ``pinhole``, and that in the middle.
            X_WB: pose of the body that carries the camera, in the middle of the exposure.
            w_WB, v_WB: its angular velocity (rad/s) and velocity (m/s) in world.
            frame: number of the picture >= 0.
            seed: of the noise, in the place of the chain's.
        """
        poses = self._shutter.poses(X_WB, w_WB, v_WB)
        ideal = expose(poses, X_WB @ self.pinhole.X_BC)
        return _TakenPicture(ideal, self._lens, self._sensor, frame, seed)


@dc.dataclass(frozen=True)
class _TakenPicture:
    """What picture() returns: an ideal picture, through lens and sensor."""

    ideal: Any
    lens: Lens | None
    sensor: Sensor
    frame: int
    seed: int | None

    def draw(self, out: np.ndarray, boxes: np.ndarray | None = None) -> None:
        boxes = as_boxes(boxes, out)
        if self.lens is None:
            self.ideal.draw(out, boxes)
        else:
            pinhole = self.lens.pinhole
            wide = np.empty((pinhole.height, pinhole.width, *out.shape[2:]), np.uint8)
            for box in boxes:
                size = pinhole.width, pinhole.height
                self.ideal.draw(wide, [self.lens.distortion.source(box, size)])
                self.lens.distortion.bend(wide, out, box)
        self.sensor.expose(out, self.frame, boxes, self.seed)
