"""The recording's part of a scenario."""

import dataclasses as dc

from airrace.common.errors import UserError

CONTENTS = ("none", "light", "full")


@dc.dataclass
class RecordingConfig:
    """What race.mcap holds. It costs time and space, and changes nothing in the race."""

    content: str = "full"  # or "light", without pictures; or "none", no race.mcap
    state_rate: float = 50.0  # Hz, of states, reference and rotors
    pose_rate: float = 30.0  # Hz, of the poses that a 3-D view moves things by
    image_rate: float = 5.0  # Hz, up to the camera's
    image_width: int = 640  # px, wider pictures are made smaller
    jpeg_quality: int = 75
    flush_period: float = 0.5  # s, what a crash can cost

    def check(self, fps: float) -> None:
        """Raises UserError on a bad combination of values; fps: the camera's (Hz)."""
        if self.content not in CONTENTS:
            raise UserError(
                f"recording.content must be one of {', '.join(CONTENTS)}, not '{self.content}'."
            )
        if self.content == "full" and self.image_rate > fps:
            raise UserError(
                f"recording.image_rate must be at most camera.fps, {fps:g} Hz, "
                f"not {self.image_rate:g}."
            )


# Least and greatest value, for the scenario's check of all numbers.
RANGES = {
    "recording.state_rate": (1, 1000),
    "recording.pose_rate": (1, 1000),
    "recording.image_rate": (0.1, 1000),
    "recording.image_width": (16, 8192),
    "recording.jpeg_quality": (1, 100),
    "recording.flush_period": (0.01, 60),
}
