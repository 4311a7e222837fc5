"""Colours that mean the same on every page: the live view, the report, pictures and lessons.

The scale of speeds goes from blue (at rest) over pink to amber (at the limit). Its hue runs
evenly and its lightness rises evenly (OKLCH: hue 262 to 72 degrees, lightness 0.50 to 0.80),
so that it is read on white and on dark paper, in grey, and by eyes that do not tell red from
green.
"""

import numpy as np
from numpy.typing import ArrayLike

# From no speed to the limit, evenly apart; linear in between, as in a CSS linear-gradient().
SPEED_STOPS = ("#265bc5", "#7459cd", "#a959bf", "#d45fa2", "#f16e7d", "#ff8954", "#faab35")
BEST = "#2f7fd6"  # the best lap, and what went as it should
BAD = "#d9540f"  # what failed
EARLIER = "#e8720c"  # plans that another one has replaced


def speed_colors(speeds: ArrayLike, max_speed: float) -> np.ndarray:
    """Returns the colours of some speeds on the scale of SPEED_STOPS.

    Args:
        speeds: (n,) m/s.
        max_speed: the end of the scale (m/s), see scenario.lap_limits.speed_scale_end().

    Returns:
        RGB from 0 to 1, (n, 3).
    """
    share = np.clip(np.asarray(speeds, float) / max_speed, 0.0, 1.0)
    stops = np.array([rgb(stop) for stop in SPEED_STOPS])
    places = np.linspace(0.0, 1.0, len(stops))
    return np.column_stack([np.interp(share, places, channel) for channel in stops.T])


def rgb(color: str) -> tuple[float, float, float]:
    """Returns the channels, from 0 to 1, of a colour such as ``#265bc5``."""
    r, g, b = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b
