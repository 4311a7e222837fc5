"""A client of the AI Grand Prix: finds orange gates in pictures, and flies through them.

    airrace grand-prix                       # in one terminal
    python examples/grand_prix_pilot.py      # in another

It knows what its specification says and nothing of the simulator: MAVLink at port 14550, pictures
at 5600. The IMU says how the drone moves. In every picture, the corners of orange squares give the
gates' places (PnP), which are averaged on a map. It flies from gate to gate, by body rates and
thrust, with one command for every sample of the IMU. Frames: N is NED from where it starts, its x
axis where the drone looks at first; B is the body, x forward, y right, z down.
"""

import argparse
import socket
import struct

import cv2
import numpy as np
from pymavlink import mavutil

GRAVITY = np.array([0.0, 0.0, 9.81])  # m/s^2, in N
HOVER_THRUST = 0.26
K = np.array([[320.0, 0.0, 320.0], [0.0, 320.0, 180.0], [0.0, 0.0, 1.0]])
UP = np.deg2rad(20.0)  # the camera's tilt; its axes in B are the columns:
R_BC = np.array([[0, np.sin(UP), np.cos(UP)], [1, 0, 0], [0, np.cos(UP), -np.sin(UP)]])
SQUARE = 1.35 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], float)  # m
DARKEST, BRIGHTEST = (0, 60, 225), (90, 170, 255)  # BGR of a gate's front
LONGEST_LEG = 16.5  # m
STATUS = struct.Struct("<BQqqIq")  # of the race


def unit(v):
    return v / max(np.linalg.norm(v), 1e-9)


def rotation(vector):
    return cv2.Rodrigues(np.asarray(vector, float))[0]


class Motion:
    """Where the drone is, by its IMU alone: attitude R_NB, velocity and position in N."""

    def __init__(self):
        self.time, self.R, self.v, self.p = None, np.eye(3), np.zeros(3), np.zeros(3)
        self.past = []  # (time, R, p), of the last second

    def add(self, time, force, rates):
        if self.time is None:  # at rest, the specific force points up
            roll, pitch = np.arctan2(-force[1], -force[2]), np.arctan2(force[0], -force[2])
            self.R = rotation([0, pitch, 0]) @ rotation([roll, 0, 0])
        elif time > self.time:
            dt = time - self.time
            a = self.R @ force + GRAVITY
            self.p = self.p + self.v * dt + a * dt**2 / 2
            self.v = self.v + a * dt
            self.R = self.R @ rotation(rates * dt)
        self.time, self.rates = time, rates
        self.past = [*self.past[-60:], (time, self.R, self.p)]

    def rest(self):
        """Forgets what was added up while the drone stood on its pad."""
        self.v, self.p = np.zeros(3), np.zeros(3)

    def at(self, time):
        """Returns R_NB and position at an earlier time, between two samples."""
        for before, after in zip(self.past, self.past[1:]):
            if before[0] <= time <= after[0]:
                share = (time - before[0]) / (after[0] - before[0])
                turn = cv2.Rodrigues(before[1].T @ after[1])[0].ravel()
                return before[1] @ rotation(share * turn), before[2] + share * (
                    after[2] - before[2]
                )
        return self.R, self.p


class Pictures:
    """Puts pictures together from their datagrams."""

    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.socket.bind(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.frame, self.parts = None, {}

    def drain(self):
        """Yields (time, picture) of every picture that is complete."""
        while True:
            try:
                data = self.socket.recv(65535)
            except BlockingIOError:
                return
            frame, chunk, total, _, size, time_ns = struct.unpack_from("<IHHIIQ", data)
            if frame != self.frame:
                self.frame, self.parts = frame, {}
            self.parts[chunk] = data[24 : 24 + size]
            if len(self.parts) == total:
                jpeg = b"".join(self.parts[i] for i in range(total))
                self.parts = {-1: b""}  # so that its copies are not complete again
                yield time_ns / 1e9, cv2.imdecode(np.frombuffer(jpeg, np.uint8), 1)


def gates_in(picture):
    """Returns the places of gates in the camera's frame (m), of those that are wholly in view."""
    orange = cv2.inRange(picture, DARKEST, BRIGHTEST)
    height, width = orange.shape
    places = []
    for contour in cv2.findContours(orange, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
        x, y, w, h = cv2.boundingRect(contour)
        if min(w, h) < 12 or x < 2 or y < 2 or x + w > width - 2 or y + h > height - 2:
            continue
        corners = cv2.approxPolyDP(contour, 0.04 * cv2.arcLength(contour, True), True)[:, 0]
        if len(corners) != 4 or cv2.contourArea(contour) < 0.93 * cv2.contourArea(corners):
            continue
        middle = corners.mean(axis=0)
        angles = np.arctan2(corners[:, 1] - middle[1], corners[:, 0] - middle[0])
        corners = corners[np.argsort(angles)].astype(float)  # upper left first, clockwise
        corners += 0.5 * np.sign(corners - middle)  # a contour runs through middles of pixels
        found, _, place = cv2.solvePnP(SQUARE, corners, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        if found and 2.0 < place[2, 0] < 30.0:
            places.append(place.ravel())
    return places


class Pilot:
    """Flies to the next gate on its map, or looks for it: lower, and to both sides."""

    def __init__(self, speed):
        self.speed, self.motion = speed, Motion()
        self.gates = []  # of the map: [place, weight, whether it was passed]
        self.target, self.last, self.leg, self.lost = None, np.zeros(3), None, None

    def look(self, time, picture):
        """Adds what is in a picture to the map."""
        R, p = self.motion.at(time)
        for place in gates_in(picture):
            seen, weight = p + R @ R_BC @ place, 1.0 / (place @ place)
            near = min(self.gates, key=lambda gate: np.linalg.norm(gate[0] - seen), default=None)
            if near is None or np.linalg.norm(near[0] - seen) > 1.5 + 0.1 * np.linalg.norm(place):
                self.gates.append([seen, weight, False])
            elif not near[2]:
                near[1] = min(near[1] + weight, 20 * weight)  # what is seen from near counts more
                near[0] = near[0] + weight / near[1] * (seen - near[0])

    def choose(self):
        """Sets the target: of the gates ahead of the last one, the nearest to it."""
        if self.leg is None:
            self.leg = unit(self.motion.R[:, 0] * [1, 1, 0])
        if self.target is not None:
            way = self.target[0] - self.motion.p
            if np.linalg.norm(way) > 2.0:
                self.leg = unit(way)
            elif way @ self.leg < -0.3:  # passed
                self.target[2], self.last, self.target = True, self.target[0], None
        if self.target is None or np.linalg.norm(self.target[0] - self.motion.p) > 4.0:
            leg = self.leg if self.target is None else unit(self.target[0] - self.last)
            ahead = [
                gate
                for gate in self.gates
                if not gate[2]
                and np.linalg.norm(gate[0] - self.last) < LONGEST_LEG
                and unit(gate[0] - self.last) @ leg > 0.3
            ]
            self.target = min(ahead, key=lambda g: np.linalg.norm(g[0] - self.last), default=None)

    def command(self):
        """Returns thrust (0 to 1) and body rates (rad/s)."""
        self.choose()
        motion, R = self.motion, self.motion.R
        if self.target is not None:
            self.lost = None
            # Along the leg if the gate is near, and straight at it else.
            way = self.target[0] - motion.p
            velocity = self.speed * (unit(way) if np.linalg.norm(way) > 1.0 else self.leg)
            look = way if np.linalg.norm(way) > 2.0 else self.leg
            bearing = np.arctan2(look[1], look[0])
        else:
            self.lost = motion.time if self.lost is None else self.lost
            seconds = motion.time - self.lost
            # Gates below are out of sight: go down, slowly on, and look to both sides.
            velocity = 0.8 * self.leg * [1, 1, 0] + [0, 0, 0.8 if motion.p[2] < -1.6 else 0.0]
            bearing = np.arctan2(self.leg[1], self.leg[0]) + 0.8 * np.sin(seconds)
        a = np.clip(2.5 * (velocity - motion.v), [-7, -7, -6], [7, 7, 5])
        thrust = GRAVITY - a  # per mass, in N, against the z axis of B
        z = unit(thrust)
        y = unit(np.cross(z, [np.cos(bearing), np.sin(bearing), 0.0]))
        wanted = np.column_stack([np.cross(y, z), y, z])
        error = cv2.Rodrigues(R.T @ wanted)[0].ravel()
        rates = np.clip([8.0, 8.0, 2.5] * error, [-6, -6, -2], [6, 6, 2])
        share = HOVER_THRUST * (thrust @ R[:, 2]) / 9.81
        return float(np.clip(share, 0.02, 0.9)), rates


def fly(pilot, link, pictures):
    """Flies until the race is over; returns its status."""
    mav, armed, samples = link.mav, False, 0
    while True:
        message = link.recv_match(blocking=True, timeout=10.0)
        if message is None:
            raise SystemExit("Nothing has come for ten seconds: is the simulator there?")
        kind = message.get_type()
        if kind == "HEARTBEAT":
            armed = bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            if not samples:
                mav.heartbeat_send(6, 8, 0, 0, 0)  # a ground station's: here is the client
        elif kind == "ENCAPSULATED_DATA" and message.data[0] == 1:
            status = STATUS.unpack_from(bytes(message.data))
            if status[3] >= 0:
                return status
        elif kind == "HIGHRES_IMU":
            samples += 1
            force = np.array([message.xacc, message.yacc, message.zacc])
            rates = np.array([message.xgyro, message.ygyro, message.zgyro])
            pilot.motion.add(message.time_usec / 1e6, force, rates)
            for time, picture in pictures.drain():
                pilot.look(time, picture)
            if not armed:
                pilot.motion.rest()
                if samples % 10 == 1:
                    mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                    continue
            thrust, rates = pilot.command() if armed else (0.0, np.zeros(3))
            mav.set_attitude_target_send(0, 1, 1, 128, [1, 0, 0, 0], *rates, thrust)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mavlink", type=int, default=14550, help="port (default: 14550)")
    parser.add_argument("--pictures", type=int, default=5600, help="port (default: 5600)")
    parser.add_argument("--speed", type=float, default=4.0, help="m/s (default: 4)")
    args = parser.parse_args()
    pictures = Pictures(args.pictures)
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{args.mavlink}", source_system=255)
    print(f"Waiting for a simulator at port {args.mavlink}.")
    status = fly(Pilot(args.speed), link, pictures)
    print(f"Finished: gate {status[4]} at {status[3] / 1e9:.2f} s of the simulator's clock.")


if __name__ == "__main__":
    main()
