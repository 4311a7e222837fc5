"""The limits of a lap as a word or a line: what --limits and planner.limits say."""

import math

from airrace.common.errors import UserError

_LEAST = 0.1  # m/s and m/s^2; a slower lap ends after the race
ORIGINAL = (20.0, 10.0)  # m/s, m/s^2: of the Student AirRace paper
_FASTEST_COLOR = 50.0  # m/s: where a scale of speeds ends if there is no limit


def parse_limits(text: str) -> tuple[float, float]:
    """Returns the greatest speed (m/s) and acceleration (m/s^2), inf where there is none.

    Args:
        text: "original"; "rotor", nothing but what the vehicle can do; or "v=15,a=8",
            of which either may be left out.

    Raises:
        UserError: if it is nothing of these.
    """
    if text == "original":
        return ORIGINAL
    if text == "rotor":
        return math.inf, math.inf
    found = {}
    for part in str(text).split(","):
        name, _, value = part.partition("=")
        name = name.strip()
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if name not in ("v", "a") or name in found or not _LEAST <= number < math.inf:
            raise UserError(
                f"The limits (--limits, planner.limits) '{text}' are not understood: say original "
                "(20 m/s and 10 m/s^2), rotor (all that the rotors can do), or your own in m/s "
                f"and m/s^2, at least {_LEAST}, such as v=15,a=8."
            )
        found[name] = number
    return found.get("v", math.inf), found.get("a", math.inf)


def speed_scale_end(text: str) -> float:
    """Returns where the colours of speeds end (m/s): at the limit, or at 50 m/s without one.

    Args:
        text: as of parse_limits().

    Raises:
        UserError: as parse_limits() does.
    """
    max_speed, _ = parse_limits(text)
    return max_speed if math.isfinite(max_speed) else _FASTEST_COLOR
