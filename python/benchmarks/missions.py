"""Reads missions of `skysink export` with third-party parsers, and uploads them to a MAVLink vehicle.

`.waypoints` files are read by pymavlink and by MAVSDK, `.plan` files by MAVSDK. What MAVSDK reads is uploaded over MAVLink
to MAVSDK's own vehicle side on the loopback interface, and must arrive unchanged. If a mission has both forms
(`a.plan` and `a.waypoints`), their items must agree. No vehicle is simulated.

Usage: python python/benchmarks/missions.py FILE...       Exit codes: 0 all agree, 1 a difference, 2 usage.
"""

import json
import math
import sys
import threading
from pathlib import Path

from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.mission_raw_server import MissionRawServer
from pymavlink import mavwp

PORT = 45871
WAIT_S = 30
DEGREE_E7 = 1.5e-7  # MAVLink's step, and half of one for rounding
TAKE_OFF, WAYPOINT, RETURN, SPEED = 22, 16, 20, 178


class Loopback:
    """A ground station and a vehicle that talk MAVLink in one process."""

    def __init__(self):
        self.vehicle = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
        self.ground = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self.received, self.arrived = [], threading.Event()
        self.server = MissionRawServer(self.vehicle.server_component())
        self.server.subscribe_incoming_mission(self._arrive)
        self.ground.add_any_connection(f"udpin://127.0.0.1:{PORT}")
        self.vehicle.add_any_connection(f"udpout://127.0.0.1:{PORT}")
        system = self.ground.first_autopilot(WAIT_S)
        if system is None:
            sys.exit(f"missions.py: no vehicle on port {PORT} within {WAIT_S} s")
        self.raw = MissionRaw(system)

    def _arrive(self, _result, plan, _data):
        self.received = plan.mission_items
        self.arrived.set()

    def flown(self, items):
        """The items that the vehicle received."""
        self.arrived.clear()
        self.raw.upload_mission(items)
        if not self.arrived.wait(WAIT_S):
            raise ValueError("the mission did not arrive")
        return self.received


def plain(item):
    """An item of MAVSDK as comparable numbers; an unset heading is 0."""
    params = [item.param1, item.param2, item.param3, item.param4]
    params = [0.0 if math.isnan(value) else value for value in params]
    return (item.command, item.frame, item.x, item.y, *params, item.z)


def is_same(one, other):
    """Whether items agree: positions to the resolution of MAVLink, 1e-7 degrees, other numbers to a thousandth."""
    return len(one) == len(other) and all(
        a[:2] == b[:2]
        and all(abs(x - y) <= 1 for x, y in zip(a[2:4], b[2:4]))
        and all(abs(x - y) < 1.1e-3 for x, y in zip(a[4:], b[4:], strict=True))
        for a, b in zip(one, other)
    )


def check_order(items):
    """A mission takes off, flies, and returns."""
    commands = [item[0] for item in items]
    if commands[0] != TAKE_OFF or commands[-1] != RETURN or not {*commands[1:-1]} <= {WAYPOINT, SPEED}:
        raise ValueError(f"commands {commands}: expected take-off, waypoints and speeds, return")


def read_plan(path, loopback):
    """The items of a plan, and the corners of its fence."""
    data = loopback.raw.import_qgroundcontrol_mission(str(path))
    written = json.loads(path.read_text())
    corners = written["geoFence"]["polygons"][0]["polygon"]
    fence = [(item.x / 1e7, item.y / 1e7) for item in data.geofence_items]
    agree = all(abs(a - b) < DEGREE_E7 for one, other in zip(corners, fence) for a, b in zip(one, other))
    if len(corners) != len(fence) or not agree:
        raise ValueError(f"fence of {len(fence)} corners, {len(corners)} were written")
    return data.mission_items, f"fence of {len(fence)} corners"


def read_waypoints(path, loopback):
    """The items of a waypoint file without home, read twice."""
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(path))
    by_pymavlink = [loader.wp(index) for index in range(1, count)]
    by_pymavlink = [
        (wp.command, wp.frame, round(wp.x * 1e7), round(wp.y * 1e7), wp.param1, wp.param2, wp.param3, wp.param4, wp.z)
        for wp in by_pymavlink
    ]
    by_mavsdk = loopback.raw.import_mission_planner_mission(str(path)).mission_items
    by_mavsdk = by_mavsdk[len(by_mavsdk) - len(by_pymavlink) :]  # MAVSDK may count home
    if not is_same([plain(item) for item in by_mavsdk], by_pymavlink):
        raise ValueError("pymavlink and MAVSDK read different items")
    return by_mavsdk, "read alike by pymavlink"


def check(path, loopback, seen):
    """Reads one file, uploads it, and compares it with the other files of the same name."""
    read = {".plan": read_plan, ".waypoints": read_waypoints}.get(path.suffix)
    if read is None:
        raise ValueError("expected a .plan or .waypoints file")
    items, note = read(path, loopback)
    sent = [plain(item) for item in items]
    check_order(sent)
    for number, item in enumerate(items):
        item.seq, item.current = number, int(number == 0)
    if not is_same([plain(item) for item in loopback.flown(items)], sent):
        raise ValueError("the vehicle has received other items than were sent")
    if not is_same(seen.setdefault(path.with_suffix(""), sent), sent):
        raise ValueError("other items than the plan or waypoint file of the same name")
    print(f"{path}: {len(items)} items, {note}, uploaded")


def main(paths):
    if not paths:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    loopback, seen, failed = Loopback(), {}, 0
    for path in map(Path, paths):
        try:
            check(path, loopback, seen)
        except Exception as error:  # every parser has its own exceptions
            print(f"{path}: {error}", file=sys.stderr)
            failed = 1
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
