"""A client of the AI Grand Prix: finds red gates in pictures, and flies through them.

    .venv/bin/python examples/grand_prix_client.py     # and in another terminal: airrace grand-prix

It knows the specification, and nothing of the simulator. A good IMU says how the drone moves, and
orange squares in pictures where gates are. Each message of the IMU is answered with body rates and
thrust. Frames: N begins where the drone stands, x forward, y right, z down; B is the drone's, and
begins as N, but tilted; C is the camera's, x right, y down, z forward. R_NB turns from B to N.
"""

import argparse
import select
import socket
import struct

import cv2
import numpy as np
from numpy.linalg import norm
from pymavlink import mavutil

GRAVITY = np.array([0.0, 0.0, 9.81])  # m/s^2, in N
# Sign of rates, thrust that hovers, and m/s^2 for 1 more of it: of the official simulator or not.
DIALECTS = {"official": (-1, 0.266, 53.5), "none": (1, 0.19, 51.7)}
K = np.array([[320.0, 0.0, 320.0], [0.0, 320.0, 180.0], [0.0, 0.0, 1.0]])
UP = np.deg2rad(20.0)  # the camera's tilt; its axes in B are the columns:
R_BC = np.array([[0, np.sin(UP), np.cos(UP)], [1, 0, 0], [0, np.cos(UP), -np.sin(UP)]])
SQUARE = np.array([[-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0]])
FARTHEST, LONGEST_LEG = 25.0, 17.0  # m, to a gate that is seen well, and from gate to gate
SPEED = 3.0  # m/s


def unit(v):
    return v / norm(v)


def pictures(stream, parts):
    """Yields (time, picture) of all that came; parts: {frame: {chunk: bytes}} so far."""
    while select.select([stream], [], [], 0)[0]:
        data = stream.recv(65535)
        frame, chunk, total, _, size, time_ns = struct.unpack_from("<IHHIIQ", data)
        if frame not in parts:
            parts.clear()
        chunks = parts.setdefault(frame, {})
        is_new, chunks[chunk] = chunk not in chunks, data[24 : 24 + size]  # each may come twice
        if is_new and len(chunks) == total:
            jpeg = np.frombuffer(b"".join(chunks[i] for i in range(total)), np.uint8)
            yield time_ns / 1e9, cv2.imdecode(jpeg, cv2.IMREAD_COLOR)


def gates_in(picture, R_NC):
    """Yields ways to the gates of a picture (m), and their directions of flight, in N."""
    hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    brightness = hsv[:, :, 2] * (cv2.inRange(hsv, (0, 150, 80), (10, 255, 255)) > 0)
    # The front of a gate is brighter than what is seen of its depth.
    front = (brightness > max(0.91 * brightness.max(), 80)).astype(np.uint8)
    contours, family = cv2.findContours(front, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour, (*_, parent) in zip(contours, family[0] if contours else []):
        hull, (x, y, width, height) = cv2.convexHull(contour), cv2.boundingRect(contour)
        at_rim = min(x, y, 640 - x - width, 360 - y - height) < 2
        # A hole that is small beside what is around it is a letter.
        least = 12 if parent < 0 else max(12, 0.4 * min(cv2.boundingRect(contours[parent])[2:]))
        if at_rim or min(width, height) < least or len(hull) < 4:
            continue
        # A gate behind an opening, which has a parent, may hide parts of it: sides are drawn out.
        size, grow, least = (2.72, 0.8, 0.93) if parent < 0 else (1.5, -1.8, 0.5)
        corners = cv2.approxPolyN(hull, 4)[0]
        is_whole = cv2.contourArea(contour) > least * cv2.contourArea(corners)
        off = corners - corners.mean(axis=0)
        order = np.argsort(np.arctan2(off[:, 1], off[:, 0]))  # from the upper left one clockwise
        px = (corners + grow * np.sign(off))[order].astype(float)  # pixels at edges are mixed
        _, turn, place = cv2.solvePnP(size * SQUARE, px, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        way, across, back = R_NC @ place[:, 0], *(R_NC @ cv2.Rodrigues(turn)[0]).T[[0, 2]]
        is_upright = is_whole and abs(across[2]) < 0.1 and abs(back[2]) < 0.3
        if is_upright and norm(way) < FARTHEST and -back @ unit(way) > 0.5:
            yield way - 0.13 * back, -back  # its middle, in the 0.26 m of its depth


class Gate:
    """A gate: place and direction of flight in N, how often it was seen, and when last."""

    def __init__(self, place, normal):
        self.place, self.normal, self.seen, self.time = place, normal, 0, 0.0


class Client:
    """Flies from gate to gate, or looks for the next one; R is R_NB, v and p are in N."""

    def __init__(self):
        self.time, self.R, self.v, self.p, self.past = None, None, np.zeros(3), np.zeros(3), []
        self.gates, self.target, self.count, self.lost = [], None, 0, 0.0
        self.last = Gate(self.p, np.array([1.0, 0.0, 0.0]))

    def feel(self, time, force, rates):
        """Goes on by a sample of the IMU: mean specific force and rates since the one before."""
        if self.time is None:  # at rest, the specific force points up
            y = unit(np.cross(-force, [1.0, 0.0, 0.0]))
            self.time, self.R = time, np.stack([np.cross(y, -unit(force)), y, -unit(force)])
        dt, a = time - self.time, self.R @ force + GRAVITY
        self.p, self.v = self.p + self.v * dt + a * dt**2 / 2, self.v + a * dt
        self.R, self.time = self.R @ cv2.Rodrigues(rates * dt)[0], time
        self.past = [*self.past[-30:], (time, self.R, self.p)]

    def look(self, time, picture):
        """Corrects gates, and the velocity, by what is in a picture."""
        _, R, p = min(self.past, key=lambda past: abs(past[0] - time))
        for way, normal in gates_in(picture, R @ R_BC):
            place, distance = p + way, norm(way)
            gate = min(self.gates, key=lambda g: norm(g.place - place), default=None)
            if gate is None or norm(gate.place - place) > 2.0 + 0.1 * distance:
                gate = Gate(place, normal)
                self.gates.append(gate)
            gate.seen, gate.time = gate.seen + 1, time
            error, trust = place - gate.place, min(1.0, (3.0 / distance) ** 2)  # far ones are off
            gate.place = gate.place + max(1.0 / gate.seen, 0.2 * trust) * error
            gate.normal = unit(gate.normal + max(1.0 / gate.seen, 0.1 * trust) * normal)
            if gate is self.target and gate.seen > 5:  # a gate that drifts: the velocity is off
                self.v = self.v - 0.03 * trust * np.clip(error, -0.3, 0.3)

    def hear(self, count):
        """Takes up how many gates count as passed."""
        if count > self.count and self.target is not None:
            self.gates.remove(self.target)
            self.last, self.target = self.target, None
        self.count = count

    def choose(self):
        """Sets the target: the nearest to the last gate, of those ahead of it."""
        if self.target is not None:
            self.lost, way = self.time, self.target.place - self.p
            if way @ self.target.normal < -2.5:  # it did not count
                self.gates.remove(self.target)
            elif norm(way) < 4.0:
                return
        legs = {g: g.place - self.last.place for g in self.gates if g.seen > 3}
        ahead = [g for g, leg in legs.items() if leg @ self.last.normal > 0.5 * norm(leg)]
        near = [g for g in ahead if norm(legs[g]) < LONGEST_LEG and self.time - g.time < 5.0]
        # What is not seen any more may not be there.
        self.target = min(near, key=lambda g: norm(legs[g]) + self.time - g.time, default=None)

    def wish(self):
        """Returns the velocity (m/s) that it wants, and where to look, in N."""
        if self.target is not None:
            way, normal = self.target.place - self.p, self.target.normal
            along = way @ normal  # first to the line through the gate, and then along it
            aim = way - along * normal + 0.6 * max(along, 1.0) * normal
            return SPEED * unit(aim), way if along > 2.0 else normal
        # What is below, or far aside, is out of sight: go up and down, and look around.
        seconds, normal = self.time - self.lost, self.last.normal
        place = self.last.place + 1.5 * normal + [0.0, 0.0, 2.0 * np.sin(0.8 * seconds)]
        place[2] = min(place[2], -1.0)  # above the ground
        yaw = np.arctan2(normal[1], normal[0]) + min(0.3 * seconds, 2.5) * np.sin(1.2 * seconds)
        return np.clip(place - self.p, -1.0, 1.0), [np.cos(yaw), np.sin(yaw)]

    def command(self):
        """Returns the specific force along -z of B (m/s^2), and body rates (rad/s)."""
        self.choose()
        velocity, look = self.wish()
        thrust = GRAVITY - np.clip(2.5 * (velocity - self.v), -2.5, 2.5)  # by mass, against z of B
        z = unit(thrust)
        y = unit(np.cross(z, [look[0], look[1], 0.0]))
        error = cv2.Rodrigues(self.R.T @ np.column_stack([np.cross(y, z), y, z]))[0][:, 0]
        rates = np.clip([8.0, 8.0, 2.5] * error, [-6, -6, -2], [6, 6, 2])
        return thrust @ self.R[:, 2], rates


def fly(client, link, stream, dialect):
    """Flies until the race is over; returns how many gates count, and the time of the finish."""
    sign, hover, slope = dialect
    armed, started, parts, level, epoch = False, False, {}, [1, 0, 0, 0], np.inf
    while message := link.recv_match(blocking=True, timeout=120):
        kind = message.get_type()
        if kind == "HEARTBEAT":
            armed = bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            link.mav.heartbeat_send(6, 8, 0, 0, 0)  # a ground station's: here is the client
        elif kind == "TIMESYNC":  # pictures have another clock, whose zero is the epoch's
            epoch = min(epoch, (message.tc1 - message.ts1) / 1e9)
        elif kind == "ENCAPSULATED_DATA" and message.data[0] == 1:  # race status
            _, now, start, finish, count, _ = struct.unpack_from("<BQqqIq", bytes(message.data))
            if finish >= 0:
                return count, finish / 1e9
            started = 0 <= start <= now  # before, a drone that moves is disqualified
            client.hear(count)
        elif kind == "HIGHRES_IMU":
            force = np.array([message.xacc, message.yacc, message.zacc])
            rates = sign * np.array([message.xgyro, message.ygyro, message.zgyro])
            client.time = client.time if started else None  # still at rest
            client.feel(message.time_usec / 1e6, force, rates)
            link.mav.timesync_send(0, 1000 * message.time_usec)
            for time, picture in pictures(stream, parts):
                if started and time - epoch > client.past[0][0]:
                    client.look(time - epoch, picture)
            if not armed:
                link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                continue
            force, rates = client.command() if started else (0.0, np.zeros(3))
            thrust = np.clip(hover + (force - GRAVITY[2]) / slope, 0.02, 0.9) * started
            # 144: only rates and thrust count, and rates are in rad/s.
            link.mav.set_attitude_target_send(0, 1, 1, 144, level, *(sign * rates), thrust)
    raise SystemExit("Nothing has come for two minutes: is the simulator there?")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mavlink", type=int, default=14550, help="port (default: 14550)")
    parser.add_argument("--pictures", type=int, default=5600, help="port (default: 5600)")
    parser.add_argument("--quirks", choices=DIALECTS, default="official", help="as the simulator's")
    args = parser.parse_args()
    stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)
    stream.bind(("127.0.0.1", args.pictures))
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{args.mavlink}", source_system=255)
    print(f"Waiting for a simulator at port {args.mavlink}.", flush=True)
    count, finish = fly(Client(), link, stream, DIALECTS[args.quirks])
    print(f"Finished: gate {count} at {finish:.2f} s of the simulator's clock.")
