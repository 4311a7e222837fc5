"""A client of `airrace grand-prix` on MAVSDK, in an environment that has it.

    python benchmarks/grand_prix_mavsdk.py PORT

It connects, reads the IMU, arms, takes off, flies a square and lands, all by set-points of
position, and prints what became of that as JSON, one line.
"""

import json
import sys
import threading
import time

import mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, PositionNedYaw
from mavsdk.plugins.telemetry import Telemetry

_PATIENCE = 120.0  # s, until the simulator is there
_SIDE, _HEIGHT = 2.0, 2.0  # m, of the square
_LEG = 4.0  # s, for each leg


def main(port: int) -> dict:
    """Returns what became of each step."""
    steps = {"version": mavsdk.__version__}
    component = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    with mavsdk.Mavsdk(component) as sdk:
        result = sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        steps["listens"] = result.name
        began = time.monotonic()
        system = sdk.first_autopilot(_PATIENCE)
        if system is None:
            # What there is, if it does not pass for an autopilot.
            steps["systems"] = [each.component_ids() for each in sdk.get_systems()]
            return steps | {"connects": False}
        steps |= {"connects": True, "after_s": time.monotonic() - began}
        steps["autopilot"] = system.autopilot_type().name
        steps["vehicle"] = system.vehicle_type().name
        _use(system, steps)
    return steps


def _use(system, steps):
    telemetry, action = Telemetry(system), Action(system)
    seen, enough = [], threading.Event()

    def see(imu, _):
        seen.append(imu)
        if len(seen) >= 62:
            enough.set()

    telemetry.subscribe_imu(see)
    steps["imu_in_10_s"] = enough.wait(10.0)
    steps["imu_messages"] = len(seen)
    if seen:
        force = seen[-1].acceleration_frd
        steps["imu_m_s2"] = [force.forward_m_s2, force.right_m_s2, force.down_m_s2]
    steps["arms"] = _tried(action.arm)
    time.sleep(1.0)
    steps["armed_in_telemetry"] = bool(telemetry.armed())
    offboard = Offboard(system)
    corners = [(0.0, 0.0), (_SIDE, 0.0), (_SIDE, _SIDE), (0.0, _SIDE), (0.0, 0.0)]
    off = []
    for i, (north, east) in enumerate(corners):
        corner = PositionNedYaw(north, east, -_HEIGHT, 0.0)
        steps["offboard_setpoint"] = _tried(offboard.set_position_ned, corner)
        if i == 0:
            steps["offboard_starts"] = _tried(offboard.start)
        time.sleep(_LEG)
        place = telemetry.position_velocity_ned().position
        if i == 0:
            steps["climbed_m"] = -place.down_m
        off.append(max(abs(place.north_m - north), abs(place.east_m - east)))
    steps["square_m"] = max(off)  # greatest distance from a corner, in north or east
    for i in range(9):
        down = PositionNedYaw(0.0, 0.0, -_HEIGHT * (1.0 - i / 8), 0.0)
        offboard.set_position_ned(down)
        time.sleep(0.5)
    time.sleep(_LEG)
    steps["landed"] = -telemetry.position_velocity_ned().position.down_m < 0.3
    steps["disarms"] = _tried(action.disarm)


def _tried(call, *arguments):
    """Returns how a call ended, as words."""
    try:
        result = call(*arguments)
    except Exception as e:  # each plugin has errors of its own
        return f"{type(e).__name__}: {e}"
    return getattr(result, "name", "done")


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]))))
