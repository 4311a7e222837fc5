"""A map that is known before the race, in place of eyes."""

import json
from pathlib import Path

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from airrace.errors import UserError
from airrace.systems.types import Detections, GateEstimate, GateMap, MarkerEstimate
from airrace.track import Track, load_track

TRACK = "track"  # in the place of a file: where the gates really are


class KnownMap(LeafSystem):
    """Shows a map that never changes.

    .. pydrake_system::

        name: KnownMap
        output_ports:
        - gate_map

    It takes the GateMapper's place.
    """

    def __init__(self, gate_map: GateMap):
        """Args: gate_map: the map."""
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort(
            "gate_map", lambda: Value[object](gate_map),
            lambda context, output: output.set_value(gate_map), {self.nothing_ticket()})


class NoDetector(LeafSystem):
    """Sees nothing.

    .. pydrake_system::

        name: NoDetector
        output_ports:
        - detections

    It takes the ArucoDetector's place in a race with a KnownMap.
    """

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareAbstractOutputPort(
            "detections", lambda: Value[object](Detections()),
            lambda context, output: output.set_value(Detections()), {self.nothing_ticket()})


def load_map(name: str, track_name: str) -> GateMap:
    """Returns the map of a scenario.

    Args:
        name: TRACK, or the map.json of an earlier race.
        track_name: of the scenario's track.

    Raises:
        UserError: if there is no such map.
    """
    if name == TRACK:
        return true_map(load_track(track_name))
    try:
        data = json.loads(Path(name).read_text(encoding="utf-8"))
        gates = tuple(
            GateEstimate(
                number=int(gate["gate"]) - 1, p_WG=_vector(gate["midpoint"]),
                heading=np.deg2rad(_number(gate["heading_deg"])),
                spacing=_number(gate["spacing"]))
            for gate in data["gates"])
        markers = tuple(
            MarkerEstimate(int(m["id"]), 1, 0, _vector(m["position"]), np.zeros(3),
                           _vector(m["normal"]))
            for m in data["markers"])
    except OSError as e:
        raise UserError(
            f"The map {name} cannot be read ({e.strerror}); give the map.json of an earlier "
            f"race, or '{TRACK}'.") from None
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"{name} is not a map: give the map.json of an earlier race, or '{TRACK}'.") from None
    numbers = [gate.number for gate in gates]
    if len(gates) < 2 or sorted(numbers) != list(range(len(gates))):
        raise UserError(f"The map {name} must have all gates, two or more; it has "
                        f"{', '.join(str(n + 1) for n in numbers) or 'none'}.")
    return GateMap(gates=tuple(sorted(gates, key=lambda gate: gate.number)), markers=markers)


def true_map(track: Track) -> GateMap:
    """Returns the map that one with perfect eyes would make."""
    return GateMap(
        gates=tuple(
            GateEstimate(number=n, p_WG=gate.p_WG, heading=gate.heading,
                         spacing=gate.pylon_spacing)
            for n, gate in enumerate(track.gates)),
        markers=tuple(
            MarkerEstimate(board.id, 1, 0, board.X_WM.translation(), np.zeros(3),
                           board.X_WM.rotation().matrix()[:, 2])
            for board in track.boards()))


def _number(value) -> float:
    number = float(value)
    if not np.isfinite(number):
        raise ValueError
    return number


def _vector(values) -> np.ndarray:
    result = np.array([_number(value) for value in values])
    if result.shape != (3,):
        raise ValueError
    return result
