"""A vehicle whose MAVLink side is MAVSDK's, for `skysink run --vehicle`; its motion is a trapezoidal speed profile.

    pip install mavsdk
    python3 examples/mavsdk_vehicle.py [--speed-factor 2] [--connect udpout://127.0.0.1:14540]
    skysink run FIELD.toml --pace realtime \\
        --vehicle 'udpin:127.0.0.1:14540?system=1&modes=follow:50593792,follow:33816576,return:84148224'

MAVSDK gives it no type and an autopilot of its own: the address names the system, and the numbers of Hold, Takeoff and Return.
It sends a heartbeat in a second of the clock, so that a vehicle that is more than twice as fast is silent for too long.

MAVSDK answers arming, take-off, changes of mode and parameters as it does for a ground station, and encodes the telemetry. It
has no answer to repositions, speeds and returns: these commands are taken from its MavlinkDirectServer and answered here.
"""

import argparse
import json
import math
import time

from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action_server.action_server import ActionServer, AllowableFlightModes, FlightMode
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import MavlinkDirectServer, MavlinkMessage
from mavsdk.plugins.param_server.param_server import ParamServer
from mavsdk.plugins.telemetry_server.telemetry_server import (
    Battery, Heading, LandedState, Position, TelemetryServer, VelocityNed, VtolState,
)

M_PER_DEG = 111_195.0
HOME_M = 488.0
CLIMB_MPS, DESCENT_MPS = 2.5, 1.5
RETURN, TAKE_OFF, SPEED, REPOSITION = 20, 22, 178, 192
ACCEPTED, DENIED = 0, 2
GLOBAL = 0  # the frame with altitudes above sea


class Vehicle:
    """A copter at home, with east, north and up in metres."""

    def __init__(self, options):
        self.home = options.home
        self.acceleration = options.acceleration
        self.speed = 10.0
        self.at, self.velocity, self.target = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], None
        self.is_armed = self.returns = False
        self.battery = 100.0

    def geodetic(self):
        lat = self.home[0] + self.at[1] / M_PER_DEG
        return lat, self.home[1] + self.at[0] / (M_PER_DEG * math.cos(math.radians(self.home[0])))

    def local(self, lat, lon):
        return [(lon - self.home[1]) * M_PER_DEG * math.cos(math.radians(self.home[0])), (lat - self.home[0]) * M_PER_DEG]

    def step(self, dt):
        if self.target is None:
            return
        self.battery = max(0.0, self.battery - 100.0 * dt / 1200.0)
        away = [target - at for target, at in zip(self.target, self.at)]
        distance = math.hypot(away[0], away[1])
        speed = min(self.speed, math.sqrt(2.0 * self.acceleration * distance), distance / dt)
        for axis in (0, 1):
            wanted = speed * away[axis] / distance if distance > 1e-6 else 0.0
            most = self.acceleration * dt
            self.velocity[axis] += min(most, max(-most, wanted - self.velocity[axis]))
        limit = CLIMB_MPS if away[2] > 0.0 else DESCENT_MPS
        self.velocity[2] = math.copysign(min(limit, abs(away[2]) / dt), away[2])
        self.at = [at + velocity * dt for at, velocity in zip(self.at, self.velocity)]
        if self.returns:
            self.come_home()

    def come_home(self):
        if math.hypot(self.at[0], self.at[1]) > 0.3:
            self.target = [0.0, 0.0, self.at[2]]
        elif self.at[2] > 0.01:
            self.target = [0.0, 0.0, -1.0]
        else:
            self.at, self.velocity = [self.at[0], self.at[1], 0.0], [0.0, 0.0, 0.0]
            self.target, self.is_armed, self.returns = None, False, False


class Side:
    """The vehicle's side of MAVLink."""

    def __init__(self, vehicle, component):
        self.vehicle, self.was_armed, self.takes_off = vehicle, False, False
        self.telemetry = TelemetryServer(component)
        self.action = ActionServer(component)
        self.direct = MavlinkDirectServer(component)
        self.params = ParamServer(component)
        self.params.provide_param_int("NAV_DLL_ACT", 2)
        self.params.provide_param_int("COM_DLL_EXCEPT", 0)
        self.action.set_armable(True, True)
        self.action.set_disarmable(True, True)
        self.action.set_allow_takeoff(True)
        self.action.set_allowable_flight_modes(AllowableFlightModes(True, True, True))
        self.action.set_flight_mode_internal(FlightMode.HOLD)
        self.action.subscribe_arm_disarm(self.arm)
        self.action.subscribe_takeoff(self.take_off)
        for command in (RETURN, TAKE_OFF, SPEED, REPOSITION):
            self.direct.subscribe_command(command, self.command)

    def arm(self, result, change, _):
        print("arm" if change.arm else "disarm", result.name, flush=True)
        self.vehicle.is_armed = change.arm

    def take_off(self, result, _, __):
        print("take off", result.name, flush=True)

    def command(self, message, _):
        fields = json.loads(message.fields_json)
        command = int(fields["command"])
        result = self.obey(command, message.message_name, fields)
        if command != SPEED:
            print(message.message_name, command, "->", result, flush=True)
        answer = {"command": command, "result": result, "progress": 0, "result_param2": 0,
                  "target_system": message.system_id, "target_component": message.component_id}
        self.direct.send_message(MavlinkMessage("COMMAND_ACK", 1, 1, message.system_id, message.component_id, json.dumps(answer)))

    def obey(self, command, name, fields):
        vehicle = self.vehicle
        if command == SPEED:
            vehicle.speed = float(fields["param2"])
        elif command == TAKE_OFF:
            if not vehicle.is_armed:
                return DENIED
            vehicle.target = [vehicle.at[0], vehicle.at[1], float(fields["param7"])]
            self.action.set_flight_mode_internal(FlightMode.TAKEOFF)
            self.takes_off = True  # which ends in Hold, as PX4's
        elif command == RETURN:
            vehicle.returns = True
            self.action.set_flight_mode_internal(FlightMode.RETURN_TO_LAUNCH)
        elif vehicle.target is None or name != "COMMAND_INT" or vehicle.returns:
            return DENIED
        else:
            up = float(fields["z"]) - (HOME_M if fields["frame"] == GLOBAL else 0.0)
            vehicle.target = vehicle.local(fields["x"] / 1e7, fields["y"] / 1e7) + [up]
        return ACCEPTED

    def publish(self):
        vehicle = self.vehicle
        lat, lon = vehicle.geodetic()
        east, north, up = vehicle.velocity
        position = Position(lat, lon, HOME_M + vehicle.at[2], vehicle.at[2])
        self.telemetry.publish_position(position, VelocityNed(north, east, -up), Heading(0.0))
        if self.takes_off and not vehicle.returns and abs(vehicle.target[2] - vehicle.at[2]) < 0.3:
            self.takes_off = False
            self.action.set_flight_mode_internal(FlightMode.HOLD)

    def publish_slowly(self):
        in_air = self.vehicle.target is not None
        battery = Battery(12.0, self.vehicle.battery / 100.0)  # MAVSDK 4.1 multiplies by 100
        self.telemetry.publish_extended_sys_state(VtolState.UNDEFINED, LandedState.IN_AIR if in_air else LandedState.ON_GROUND)
        self.telemetry.publish_battery(battery)
        self.telemetry.publish_sys_status(battery, True, True, True, True, True)
        if self.was_armed and not self.vehicle.is_armed:
            self.action.set_armed_state(False)  # has landed
        self.was_armed = self.vehicle.is_armed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--connect", default="udpout://127.0.0.1:14540")
    parser.add_argument("--speed-factor", type=float, default=1.0)
    parser.add_argument("--acceleration", type=float, default=2.5)
    parser.add_argument("--home", type=lambda text: [float(word) for word in text.split(",")], default=[47.3977, 8.5456])
    options = parser.parse_args()
    mavsdk = Mavsdk(Configuration.create_manual(1, 1, True))
    vehicle = Vehicle(options)
    side = Side(vehicle, mavsdk.server_component())
    print(options.connect, mavsdk.add_any_connection(options.connect).name, "MAVSDK", mavsdk.version(), flush=True)
    begin, now, step = time.monotonic(), 0.0, 0
    while True:
        target = (time.monotonic() - begin) * options.speed_factor
        while now + 0.02 <= target:
            now += 0.02
            step += 1
            vehicle.step(0.02)
            if step % 3 == 0:
                side.publish()
            if step % 50 == 0:
                side.publish_slowly()
        time.sleep(0.002)


if __name__ == "__main__":
    main()
