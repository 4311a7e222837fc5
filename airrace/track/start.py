"""Where a race starts: the pad, and how a drone stands on it."""

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

_EDGE = 0.02  # m, height of the lowest edge of a tilted pad


@dc.dataclass
class Start:
    """The pad on which the drone stands before take-off."""

    position: list[float] = dc.field(default_factory=list)  #: [x, y, z] of its centre (m, world)
    heading_deg: float = float("nan")  #: of the drone (degrees from +x)
    pad_tilt_deg: float = 0.0  #: angle between the pad and the horizontal (degrees)
    #: Horizontal direction in which the pad descends (degrees from +x, world).
    pad_tilt_direction_deg: float = 0.0

    def check(self, steepest_deg: float) -> None:
        """Raises ValueError with a clause; steepest_deg: tilt from which drones slip (degrees)."""
        require(
            len(self.position) == 3 and np.all(np.isfinite([*self.position, self.heading_deg])),
            "start.position needs three numbers, and start.heading_deg one, all finite",
        )
        require(self.position[2] >= 0.0, "the start lies below the ground")
        require(
            0.0 <= self.pad_tilt_deg <= steepest_deg,
            f"start.pad_tilt_deg must lie between 0 and {steepest_deg:.0f}",
        )
        require(
            np.isfinite(self.pad_tilt_direction_deg), "start.pad_tilt_direction_deg is not finite"
        )


def require(condition: object, message: str) -> None:
    """Raises ValueError with a message, a clause that says what is wrong, unless it is right."""
    if not condition:
        raise ValueError(message)


def pad_rotation(start: Start) -> RotationMatrix:
    """Returns the rotation that tilts the level onto the pad of a Start."""
    downhill = RotationMatrix.MakeZRotation(np.deg2rad(start.pad_tilt_direction_deg))
    tilt = RotationMatrix.MakeYRotation(np.deg2rad(start.pad_tilt_deg))
    return downhill @ tilt @ downhill.inverse()


def start_pose(start: Start, radius: float, standing_height: float) -> RigidTransform:
    """Returns X_WB of a drone that stands on its pad.

    Args: radius: of the drone (m). standing_height: of its origin above what it stands on (m).
    """
    R_WP = pad_rotation(start)
    heading = RotationMatrix.MakeZRotation(np.deg2rad(start.heading_deg))
    return RigidTransform(R_WP @ heading, pad_middle(start, radius) + standing_height * R_WP.col(2))


def pad_half_width(radius: float) -> float:
    """Returns half of the side of a square pad (m) for a drone of a radius (m)."""
    return radius + 0.2


def pad_middle(start: Start, radius: float) -> np.ndarray:
    """Returns the centre of the pad's top, (3,)."""
    if start.pad_tilt_deg == 0.0:
        return np.array(start.position, float)
    rise = _EDGE + pad_half_width(radius) * np.sin(np.deg2rad(start.pad_tilt_deg))
    return np.array(start.position) + [0.0, 0.0, rise]
