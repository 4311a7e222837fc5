"""A client of the AI Grand Prix: finds orange gates in pictures, and flies through them.

    .venv/bin/python examples/grand_prix_pilot.py     # and in another terminal: airrace grand-prix

It knows the specification and nothing of the simulator. The IMU says how the drone moves, and the
sides of orange squares where gates are. A gate that is seen again corrects its place, and the
drone's velocity. Each sample of the IMU is answered with body rates and thrust. Frames: N is NED
from the start; B the body, x forward, y right, z down; C the camera, x right, y down, z forward.
"""

import argparse
import dataclasses as dc
import socket
import struct

import cv2
import numpy as np
from pymavlink import mavutil

GRAVITY, HOVER_THRUST = np.array([0.0, 0.0, 9.81]), 0.26  # m/s^2 in N, and a share of the greatest
K = np.array([[320.0, 0.0, 320.0], [0.0, 320.0, 180.0], [0.0, 0.0, 1.0]])
SIZE = np.array([640, 360])  # px
UP = np.deg2rad(20.0)  # the camera's tilt; its axes in B are the columns:
R_BC = np.array([[0, np.sin(UP), np.cos(UP)], [1, 0, 0], [0, np.cos(UP), -np.sin(UP)]])
OUTER, INNER = 2.7, 1.5  # m, sides of a gate's frame
SQUARE = np.array([[-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0]])
EDGE = 1.0  # px, from the middle of the outermost orange pixels to the edge, as JPEG blurs it
LONGEST_LEG = 1.5 * 200 / 18  # m: courses have about 18 gates on 200 m


def unit(v):
    return v / max(np.linalg.norm(v), 1e-9)


def limited(v, most):
    return v * min(1.0, most / max(np.linalg.norm(v), 1e-9))


def rotation(vector):
    return cv2.Rodrigues(np.asarray(vector, float))[0]


class Motion:
    """How the drone moves, by its IMU: attitude R_NB, velocity v and position p in N."""

    def __init__(self):
        self.time, self.R, self.v, self.p, self.past = None, np.eye(3), np.zeros(3), np.zeros(3), []

    def add(self, time, force, rates):
        """Goes on by a sample: mean specific force and body rates since the one before."""
        if self.time is None:  # at rest, the specific force points up
            roll, pitch = np.arctan2(-force[1], -force[2]), np.arctan2(force[0], -force[2])
            self.R, self.time = rotation([0, pitch, 0]) @ rotation([roll, 0, 0]), time
        dt, a = time - self.time, self.R @ force + GRAVITY
        self.p, self.v = self.p + self.v * dt + a * dt**2 / 2, self.v + a * dt
        self.R, self.time = self.R @ rotation(rates * dt), time
        self.past = [*self.past[-30:], (time, self.R, rates, self.p, self.v)]

    def at(self, time):
        """Returns R_NB and p at a time not long ago."""
        then, R, rates, p, v = min(self.past, key=lambda past: abs(past[0] - time))
        return R @ rotation(rates * (time - then)), p + v * (time - then)


def pictures(stream, parts):
    """Yields (time, picture) of all that came; parts: of one that is not complete, a dict."""
    while True:
        try:
            data = stream.recv(65535)
        except BlockingIOError:
            return
        frame, chunk, total, _, size, time_ns = struct.unpack_from("<IHHIIQ", data)
        if parts.get("frame") != frame:
            parts.clear()
        elif chunk in parts:  # each may come twice
            continue
        parts.update({"frame": frame, chunk: data[24 : 24 + size]})
        if len(parts) == total + 1:
            jpeg = b"".join(parts[i] for i in range(total))
            yield time_ns / 1e9, cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)


def sides_of(contour):
    """Returns lines (a, b, c), ax + by + c = 0, through its four longest sides, in their order."""
    points, polygon = contour[:, 0], cv2.approxPolyDP(contour, 2.0, True)[:, 0]
    ends = np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1).astype(float)
    found = {}
    for i in np.argsort(-np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), kind="stable"):
        (a, b), along = ends[i], unit(ends[i, 1] - ends[i, 0])
        at_rim = np.any((ends[i].max(axis=0) < 3) | (ends[i].min(axis=0) > SIZE - 3))
        # A side that another gate hides in part is seen in two pieces.
        if at_rim or any(abs(ends[i] @ line[:2] + line[2]).max() < 3 for line in found.values()):
            continue
        x, y = (points - a) @ along, (points - a) @ [-along[1], along[0]]
        near = points[(x >= 0) & (x <= (b - a) @ along) & (abs(y) < 2)]
        dx, dy, x, y = cv2.fitLine(near, cv2.DIST_L2, 0, 0.01, 0.01).ravel().astype(float)
        found[i] = np.array([dy, -dx, dx * y - dy * x])
        if len(found) == 4:
            break
    return [found[i] for i in sorted(found)]


def gates_in(picture, R_NC):
    """Yields places from the drone (m), and directions of flight, in N, of gates in a picture."""
    hue, saturation, _ = cv2.split(cv2.cvtColor(picture, cv2.COLOR_BGR2HSV))
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    orange = (5 < hue) & (hue < 22) & (saturation > 150) & (grey > 50)
    # The front of a gate is brighter than what is seen of its depth.
    front = (orange & (grey > 0.91 * grey[orange].max(initial=50))).astype(np.uint8)
    contours, family = cv2.findContours(front, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour, (*_, parent) in zip(contours, family[0] if contours else []):
        lines = sides_of(contour) if min(cv2.boundingRect(contour)[2:]) >= 12 else []
        crossings = np.array([np.cross(lines[i - 1], lines[i]) for i in range(len(lines))])
        if len(lines) < 4 or np.abs(crossings[:, 2]).min() < 0.5:  # sines of their angles
            continue
        corners = crossings[:, :2] / crossings[:, 2:]
        if not 0.6 < cv2.contourArea(contour) / cv2.contourArea(corners.astype(np.float32)) < 1.2:
            continue
        off = corners - corners.mean(axis=0)
        corners += np.sign(off) * (EDGE if parent < 0 else -EDGE)  # a hole has a parent
        corners = corners[np.argsort(np.arctan2(off[:, 1], off[:, 0]))]  # upper left, clockwise
        square = (OUTER if parent < 0 else INNER) * SQUARE
        _, turns, places, errors = cv2.solvePnPGeneric(
            square, corners, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        place, across, normal = R_NC @ places[0].ravel(), *(R_NC @ rotation(turns[0])).T[[0, 2]]
        upright = abs(across[2]) < 0.1 and abs(normal[2]) < 0.3
        if upright and errors[0, 0] < 1.0 and -normal @ unit(place) > 0.5:
            yield place, -normal


@dc.dataclass(eq=False)
class Gate:
    """A gate: place and direction of flight in N, when it was seen last, and how often."""

    place: np.ndarray
    normal: np.ndarray
    time: float
    seen: int = 1
    shunned: float = 0.0  # until this time


class Pilot:
    """Flies from gate to gate, or looks for the next one."""

    def __init__(self, speed):
        self.speed, self.motion, self.gates = speed, Motion(), []
        self.last, self.target, self.count, self.lost = None, None, 0, 0.0

    def look(self, time, picture):
        """Corrects gates and velocity by what is in a picture."""
        R, p = self.motion.at(time)
        for way, normal in gates_in(picture, R @ R_BC):
            place, distance = p + way, np.linalg.norm(way)
            gate = min(self.gates, key=lambda g: np.linalg.norm(g.place - place), default=None)
            if gate is None or np.linalg.norm(gate.place - place) > 1.0 + 0.1 * distance:
                self.gates.append(Gate(place, normal, time))
                continue
            gate.seen, gate.time, trust = gate.seen + 1, time, 1.0 / (1.0 + (distance / 6.0) ** 2)
            error = limited(place - gate.place, 3.0 / gate.seen + 0.2)
            gate.place = gate.place + max(1.0 / gate.seen, 0.2 * trust) * error
            gate.normal = unit(gate.normal + max(1.0 / gate.seen, 0.1 * trust) * normal)
            if gate.seen > 5:
                self.motion.v = self.motion.v - 0.15 * trust * error

    def hear(self, count):
        """Takes up how many gates count as passed."""
        if count > self.count and self.target is not None:
            self.last, self.count, self.target = self.target, count, None
            self.gates.remove(self.last)

    def choose(self):
        """Sets the target: the nearest to the last gate, of those ahead of it."""
        motion = self.motion
        if self.last is None:
            self.last = Gate(motion.p, unit(motion.R[:, 0] * [1, 1, 0]), motion.time)
        if self.target is not None:
            self.lost = motion.time
            way = self.target.place - motion.p
            if way @ self.target.normal < -2.5:  # it did not count
                self.target.shunned, self.target = motion.time + 5.0, None
            elif np.linalg.norm(way) < 4.0:
                return
            elif motion.time - self.target.time > 2.0:  # it would be in sight if it were there
                self.gates.remove(self.target)
        leg = {g: np.linalg.norm(g.place - self.last.place) for g in self.gates}
        ahead = [
            g
            for g in self.gates
            if g.seen >= 4 and g.shunned < motion.time and 2.0 < leg[g] < LONGEST_LEG
            and (g.place - self.last.place) @ self.last.normal > 0.5 * leg[g]
        ]  # fmt: skip
        self.target = min(ahead, key=leg.get, default=None)

    def wish(self):
        """Returns the velocity (m/s) that it wants, and where to look, in N."""
        motion, last = self.motion, self.last
        if self.target is not None:
            way, normal = self.target.place - motion.p, self.target.normal
            along = way @ normal
            aim = way - along * normal + 0.6 * max(along, 1.0) * normal
            return self.speed * unit(aim), way if along > 2.0 else normal
        seconds = motion.time - self.lost
        # What is below, or far aside, is out of sight.
        place = last.place + 1.0 * last.normal + [0, 0, 1.6 * np.sin(0.8 * seconds)]
        place[2] = min(place[2], -1.0)
        turn = min(0.3 * seconds, 2.5) * np.sin(1.2 * seconds)
        return limited(place - motion.p, 1.5), rotation([0, 0, turn]) @ last.normal

    def command(self):
        """Returns thrust (0 to 1) and body rates (rad/s)."""
        self.choose()
        motion, R = self.motion, self.motion.R
        velocity, look = self.wish()
        a = 2.5 * (velocity - motion.v)
        thrust = GRAVITY - limited(a, 4.0)  # per mass, against z of B
        z = unit(thrust)
        y = unit(np.cross(z, [look[0], look[1], 0.0]))
        wanted = np.column_stack([np.cross(y, z), y, z])
        error = cv2.Rodrigues(R.T @ wanted)[0].ravel()
        rates = np.clip([8.0, 8.0, 2.5] * error, [-6, -6, -2], [6, 6, 2])
        share = HOVER_THRUST * (thrust @ R[:, 2]) / GRAVITY[2]
        return float(np.clip(share, 0.02, 0.9)), rates


def fly(pilot, link, stream):
    """Flies until the race is over; returns its status."""
    mav, armed, samples, parts = link.mav, False, 0, {}
    while True:
        message = link.recv_match(blocking=True, timeout=10.0 if samples else None)
        if message is None:
            raise SystemExit("Nothing has come for ten seconds: is the simulator there?")
        kind = message.get_type()
        if kind == "HEARTBEAT":
            armed = bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            if not samples:
                mav.heartbeat_send(6, 8, 0, 0, 0)  # a ground station's: here is the client
        elif kind == "ENCAPSULATED_DATA" and message.data[0] == 1:  # race status
            _, _, _, finish, count, _ = struct.unpack_from("<BQqqIq", bytes(message.data))
            if finish >= 0:
                return count, finish / 1e9
            pilot.hear(count)
        elif kind == "HIGHRES_IMU":
            samples += 1
            force = np.array([message.xacc, message.yacc, message.zacc])
            rates = np.array([message.xgyro, message.ygyro, message.zgyro])
            pilot.motion.add(message.time_usec / 1e6, force, rates)
            for time, picture in pictures(stream, parts):
                pilot.look(time, picture)
            if not armed:  # it stands still
                pilot.motion.v, pilot.motion.p = np.zeros(3), np.zeros(3)
            if not armed and samples % 10 == 1:
                mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                continue
            thrust, rates = pilot.command() if armed else (0.0, np.zeros(3))
            mav.set_attitude_target_send(0, 1, 1, 128, [1, 0, 0, 0], *rates, thrust)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mavlink", type=int, default=14550, help="port (default: 14550)")
    parser.add_argument("--pictures", type=int, default=5600, help="port (default: 5600)")
    parser.add_argument("--speed", type=float, default=3.0, help="m/s (default: 3)")
    args = parser.parse_args()
    stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
    stream.bind(("127.0.0.1", args.pictures))
    stream.setblocking(False)
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{args.mavlink}", source_system=255)
    print(f"Waiting for a simulator at port {args.mavlink}.", flush=True)
    count, finish = fly(Pilot(args.speed), link, stream)
    print(f"Finished: gate {count} at {finish:.2f} s of the simulator's clock.")


if __name__ == "__main__":
    main()
