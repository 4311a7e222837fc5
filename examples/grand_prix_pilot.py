"""A client of the AI Grand Prix: finds orange gates in pictures, and flies through them.

    .venv/bin/python examples/grand_prix_pilot.py     # and in another terminal: airrace grand-prix

It knows the specification, and nothing of the simulator. The IMU says how the drone moves, and
orange squares in the pictures say where gates are. Each message of the IMU is answered with body
rates and thrust. Frames: N is NED where the drone started, with x to where it looked; B is the
body, x forward, y right, z down; C is the camera, x right, y down, z forward.
"""

import argparse
import socket
import struct

import cv2
import numpy as np
from pymavlink import mavutil

GRAVITY, HOVER_THRUST = np.array([0.0, 0.0, 9.81]), 0.26  # m/s^2 in N, and a share of the greatest
K = np.array([[320.0, 0.0, 320.0], [0.0, 320.0, 180.0], [0.0, 0.0, 1.0]])
UP = np.deg2rad(20.0)  # the camera's tilt; its axes in B are the columns:
R_BC = np.array([[0, np.sin(UP), np.cos(UP)], [1, 0, 0], [0, np.cos(UP), -np.sin(UP)]])
OUTER, INNER = 2.7, 1.5  # m, sides of a gate's frame
SQUARE = np.array([[-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0]])
EDGE, DEPTH = 1.35, 0.26  # px, by which JPEG and threshold take off a front's edges; m
LONGEST_LEG, FARTHEST = 17.0, 25.0  # m: courses have 17 to 20 gates on 200 m; beyond, too small
DRIFT = 0.01  # (m/s)^2 a second, by which the IMU's velocity becomes less sure


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


def corners_of(contour, is_hole):
    """Returns where the four longest sides of a contour meet (px), upper left first, or None."""
    points, shape = contour[:, 0], cv2.convexHull(contour) if is_hole else contour
    polygon = cv2.approxPolyDP(shape, 2.0, True)[:, 0].astype(float)
    lengths, lines = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1), {}
    for i in np.argsort(-lengths, kind="stable"):
        a, b, along = polygon[i - 1], polygon[i], unit(polygon[i] - polygon[i - 1])
        x, y = (points - a) @ along, (points - a) @ [-along[1], along[0]]
        near = points[(x >= 0) & (x <= lengths[i]) & (abs(y) < 2)]
        at_rim = np.any((np.maximum(a, b) < 3) | (np.minimum(a, b) > [636, 356]))
        # Where another gate hides a part of a side, the rest of it may come in two pieces.
        known = any(max(abs(line @ [*a, 1]), abs(line @ [*b, 1])) < 3 for line in lines.values())
        if at_rim or known or len(near) < 4:
            continue
        dx, dy, x, y = cv2.fitLine(near, cv2.DIST_L2, 0, 0.01, 0.01).ravel().astype(float)
        lines[i] = np.array([dy, -dx, dx * y - dy * x])  # (a, b, c) of a x + b y + c = 0
        if len(lines) == 4:
            break
    sides = [lines[i] for i in sorted(lines)]
    crossings = np.array([np.cross(sides[i - 1], sides[i]) for i in range(len(sides))])
    if len(sides) < 4 or abs(crossings[:, 2]).min() < 0.5:  # sines of their angles
        return None
    corners = crossings[:, :2] / crossings[:, 2:]
    if not 0.5 < cv2.contourArea(contour) / cv2.contourArea(corners.astype(np.float32)) < 1.2:
        return None
    off = corners - corners.mean(axis=0)
    corners += np.sign(off) * (-EDGE if is_hole else EDGE)
    return corners[np.argsort(np.arctan2(off[:, 1], off[:, 0]))]


def gates_in(picture, R_NC):
    """Yields ways to the gates of a picture (m), and their directions of flight, in N."""
    hue, saturation, value = cv2.split(cv2.cvtColor(picture, cv2.COLOR_BGR2HSV))
    orange = (5 < hue) & (hue < 22) & (saturation > 150) & (value > 80)
    # The front of a gate is brighter than what is seen of its depth.
    front = (orange & (value > 0.91 * value[orange].max(initial=80))).astype(np.uint8)
    contours, family = cv2.findContours(front, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour, (*_, parent) in zip(contours, family[0] if contours else []):
        is_hole = parent >= 0
        if min(cv2.boundingRect(contour)[2:]) < 12 or (px := corners_of(contour, is_hole)) is None:
            continue
        _, turns, places, errors = cv2.solvePnPGeneric(
            (INNER if is_hole else OUTER) * SQUARE, px, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        if not places or errors[0, 0] > 1.0:
            continue
        way, across, back = R_NC @ places[0].ravel(), *(R_NC @ rotation(turns[0])).T[[0, 2]]
        upright = abs(across[2]) < 0.1 and abs(back[2]) < 0.3
        if upright and np.linalg.norm(way) < FARTHEST and -back @ unit(way) > 0.5:
            yield way - DEPTH / 2 * back, -back


class Gate:
    """A gate: place and direction of flight in N, when it was seen last, and how often."""

    def __init__(self, place, normal, time, sigma):
        self.place, self.normal, self.time, self.seen, self.shunned = place, normal, time, 1, 0.0
        self.P = np.diag([sigma**2, 0.1**2])  # covariance of the way to it and of v, on each axis

    def see(self, place, normal, time, sigma):
        """Takes up where it is seen, a Kalman filter; returns what that says of v."""
        dt, self.time, self.seen = time - self.time, time, self.seen + 1
        F = np.array([[1.0, -dt], [0.0, 1.0]])
        self.P = F @ self.P @ F.T + DRIFT * np.array(
            [[dt**3 / 3, -(dt**2) / 2], [-(dt**2) / 2, dt]]
        )
        gain = self.P[0] / (self.P[0, 0] + sigma**2)
        self.P = self.P - np.outer(gain, self.P[0])
        error = place - self.place
        self.place = self.place + gain[0] * error
        self.normal = unit(self.normal + max(gain[0], 0.02) * normal)
        return gain[1] * error


class Pilot:
    """Flies from gate to gate, or looks for the next one."""

    def __init__(self, speed):
        self.speed, self.motion, self.gates = speed, Motion(), []
        self.last, self.target, self.count, self.lost = None, None, 0, 0.0

    def look(self, time, picture):
        """Corrects gates and velocity by what is in a picture."""
        R, p = self.motion.at(time)
        for way, normal in gates_in(picture, R @ R_BC):
            place, sigma = p + way, 0.02 + way @ way / 500  # as a pixel is off
            gate = min(self.gates, key=lambda g: np.linalg.norm(g.place - place), default=None)
            if gate is None or np.linalg.norm(gate.place - place) > 1 + 0.1 * np.linalg.norm(way):
                self.gates.append(Gate(place, normal, time, sigma))
                continue
            slip = gate.see(place, normal, time, sigma)
            if gate is self.target:
                self.motion.v = self.motion.v + slip

    def hear(self, count):
        """Takes up how many gates count as passed."""
        if count > self.count and self.target is not None:
            self.gates.remove(self.target)
            self.last, self.count, self.target = self.target, count, None

    def choose(self):
        """Sets the target: the nearest to the last gate, of those ahead of it."""
        motion = self.motion
        if self.last is None:
            self.last = Gate(motion.p, unit(motion.R[:, 0] * [1, 1, 0]), motion.time, 1.0)
        if self.target is not None:
            self.lost, way = motion.time, self.target.place - motion.p
            if way @ self.target.normal < -2.5:  # it did not count
                self.target.shunned = motion.time + 5.0
            elif np.linalg.norm(way) < 4.0:
                return
            elif motion.time - self.target.time > 2.0:  # it would be in sight if it were there
                self.gates.remove(self.target)
        legs = {gate: gate.place - self.last.place for gate in self.gates}
        ahead = {
            gate: np.linalg.norm(leg)
            for gate, leg in legs.items()
            if gate.seen > 3
            and gate.time > motion.time - 8.0
            and gate.shunned < motion.time
            and leg @ self.last.normal > 0.5 * np.linalg.norm(leg)
            and np.linalg.norm(leg) < LONGEST_LEG
        }
        self.target = min(ahead, key=ahead.get, default=None)

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
        thrust = GRAVITY - limited(a, 3.5)  # per mass, against z of B
        z = unit(thrust)
        y = unit(np.cross(z, [look[0], look[1], 0.0]))
        wanted = np.column_stack([np.cross(y, z), y, z])
        error = cv2.Rodrigues(R.T @ wanted)[0].ravel()
        rates = np.clip([8.0, 8.0, 2.5] * error, [-6, -6, -2], [6, 6, 2])
        share = HOVER_THRUST * (thrust @ R[:, 2]) / GRAVITY[2]
        return float(np.clip(share, 0.02, 0.9)), rates


def fly(pilot, link, stream):
    """Flies until the race is over; returns how many gates count, and when it finished."""
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
