"""Vehicles in Python in the place of flight-sim."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run, same_files
from test_ring import begin, by_hand, children, end, place, slots, until

import skysink

__all__ = ["place"]

SMOKE = str(ROOT / "scenarios" / "smoke.toml")
LETTER = str(ROOT / "scenarios" / "letter.toml")

VEHICLE = """
import numpy as np
import skysink.ring

class Mine(skysink.ring.Vehicle):
    def fly(self, order):
        return {returned}

skysink.ring.vehicle(Mine())
"""


def fly(
    place: Path, returned: str, *options: str, scenario: str = SMOKE, code: int = 0
) -> subprocess.CompletedProcess[str]:
    """Flies a mission with a vehicle that returns this, into `run`."""
    (place / "vehicle.py").write_text(VEHICLE.format(returned=returned))
    command = f"{sys.executable} vehicle.py"
    return run("run", scenario, "--no-viewer", "--out", "run", "--vehicle", command, *options, cwd=place, code=code)


def rows(place: Path) -> list[list[str]]:
    """The lines of the trace."""
    return [line.split(",") for line in (place / "run" / "slots.csv").read_text().splitlines()[1:]]


def summary(place: Path) -> dict[str, object]:
    """The figures of the run."""
    found: dict[str, object] = json.loads((place / "run" / "summary.json").read_text())
    return found


def test_an_ideal_vehicle_leaves_the_trace_of_flight_sim(place: Path) -> None:
    fly(place, "order.waypoint")
    run("simulate", SMOKE, "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv", "sensors.csv"])
    assert summary(place)["external"] == ["flight-sim"]


def test_an_ideal_vehicle_with_base_battery_and_zones_leaves_the_trace_of_flight_sim(place: Path) -> None:
    (place / "base.toml").write_text("""
name = "base"
slots = 400
[area]
side_m = 200.0
[[area.no_fly]]
polygon_m = [[120.0, 40.0], [140.0, 40.0], [140.0, 160.0], [120.0, 160.0]]
[base]
charge_w = 2000.0
[uav]
must_land = true
endurance_s = 400.0
[uav.battery]
capacity_j = 15000.0
""")
    (place / "ideal.py").write_text(VEHICLE.format(returned="order.waypoint"))
    vehicle = ["--vehicle", f"{sys.executable} ideal.py", "--out", "run"]
    run("run", "base.toml", "--no-viewer", *vehicle, cwd=place)
    run("simulate", "base.toml", "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])
    assert {"charge", "return"} <= {row[9] for row in rows(place)}


def test_a_fleet_of_ideal_vehicles_leaves_the_trace_of_flight_sim(place: Path) -> None:
    fly(place, "order.waypoint", "--set", "uav.count=3")
    run("simulate", SMOKE, "--out", "alone", "--set", "uav.count=3", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])


def test_a_lagging_vehicle_is_en_route_and_loses_more(place: Path) -> None:
    assert skysink.simulate(skysink.Scenario.load(LETTER), "uts").loss_rate == 0.0
    noise = "np.random.default_rng(order.slot).normal(0.0, 1.0, 3) * [1, 1, 0]"
    fly(place, f"order.position + 0.5 * (order.waypoint - order.position) + {noise}", scenario=LETTER)
    assert summary(place)["loss_rate"] > 0.002  # type: ignore[operator]
    modes = [row[9] for row in rows(place)]
    assert modes.count("en-route") > 400 and "serve" in modes
    run("simulate", LETTER, "--out", "alone", cwd=place)
    for command in (["report", "run", "--sensors"], ["replay", "run", "--no-viewer"], ["compare", "run", "alone"]):
        run(*command, cwd=place)
    run("export", "run", "--format", "qgc-plan", "--origin", "47,8", "--north", "true", "--ignore-endurance", cwd=place)
    assert json.loads((place / "run-replay" / "replay.json").read_text())["trace_hash"] == summary(place)["trace_hash"]


def test_bits_reported_by_sensor_nodes_enter_the_ledger(place: Path) -> None:
    fly(place, "skysink.ring.Flown(order.waypoint, bits={sensor: 700 for sensor in order.serve})")
    served = [row for row in rows(place) if row[5]]
    assert len(served) > 40
    assert all(int(row[6]) <= 700 * len(row[5].split()) for row in served)
    assert any(int(row[6]) == 700 * len(row[5].split()) for row in served)
    refused = run("report", "run", "--sensors", cwd=place, code=2)
    assert "the external flight-sim had another channel" in refused.stderr


@pytest.mark.parametrize(
    ("returned", "expected"),
    [
        ("(float('nan'), 0.0)", "flight-sim: slot 1: uav 0: position = (nan, 0.0): expected"),
        ("(1.0, 2.0, 3.0, 4.0)", "expected (x, y) or (x, y, z), finite"),
        ("skysink.ring.Flown((1, 2), velocity_mps=(1, 2))", "velocity_mps = (1, 2): expected three finite numbers"),
        ("(1e39, 0.0)", "position = (1e+39, 0.0): expected (x, y) or (x, y, z), finite"),
        ("(1e9, 0.0)", "flight-sim: slot 1: uav 0: position = (1000000000, 0, 20): expected at most 100 km from the area"),
        ("'nowhere'", "position = nowhere: expected (x, y)"),
        ("None", "position = None: expected (x, y)"),
        ("skysink.ring.Flown((1, 2), energy_j=float('nan'))", "energy_j = nan: expected a number, or infinity"),
        ("skysink.ring.Flown((1, 2), bits={-1: 5})", "bits = {-1: 5}: expected at most 64 ids of sensor nodes"),
    ],
)
def test_an_impossible_report_ends_the_run_with_one_line(place: Path, returned: str, expected: str) -> None:
    said = fly(place, returned, code=1).stderr.splitlines()
    assert len(said) == 2 and expected in said[0], said
    assert said[1] == "skysink: flight-sim ended with exit code 2 in slot 1: no slot was flown"


def test_a_vehicle_outside_the_area_is_ordered_back(place: Path) -> None:
    fly(place, "(900.0, -40.0) if order.slot == 20 else order.waypoint")
    jumped, back = rows(place)[19:21]
    assert jumped[2:5] == ["900", "-40", "20"] and jumped[9] == "en-route"
    assert back[9] != "hold" and 0.0 <= float(back[2]) <= 100.0, back


def test_a_silent_vehicle_ends_the_run_with_one_line(place: Path) -> None:
    said = fly(place, "__import__('time').sleep(60 * (order.slot == 9)) or order.waypoint", "--timeout", "3", code=1).stderr
    assert "flight-sim has not sent flight(9) for 3 s" in said


def test_a_killed_and_restarted_vehicle_flies_no_slot_twice(place: Path) -> None:
    flown = "open('flown', 'a').write(f'{order.slot}\\n') and order.waypoint"
    (place / "vehicle.py").write_text(VEHICLE.format(returned=flown))
    vehicle = ["--vehicle", f"{sys.executable} vehicle.py"]
    process = begin(place, "run", "long.toml", "--no-viewer", "--out", "run", *vehicle)
    for kill in range(1, 4):
        until("flight", process, lambda kill=kill: slots(place) > 300 * kill)
        for vehicle_id in children(process, "vehicle.py"):
            os.kill(vehicle_id, signal.SIGKILL)
    assert end(process) == 0, (place / "said").read_text()
    run("simulate", "long.toml", "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])
    assert summary(place)["restarts"] >= 3  # type: ignore[operator]
    assert len((place / "flown").read_text().splitlines()) <= 1500 + 3, "at most the slot in which it was killed"


def test_a_stopped_run_is_resumed_where_the_vehicle_was(place: Path) -> None:
    (place / "vehicle.py").write_text("""
import skysink.ring

class Mine(skysink.ring.Vehicle):
    def begin(self, field, starts):
        print(starts[0].tolist(), file=open("begins", "a"))
    def fly(self, order):
        return 0.5 * (order.position + order.waypoint)

skysink.ring.vehicle(Mine())
""")
    vehicle = ["--vehicle", f"{sys.executable} vehicle.py"]
    run("run", "long.toml", "--no-viewer", "--out", "whole", *vehicle, cwd=place)
    process = begin(place, "run", "long.toml", "--no-viewer", "--out", "run", *vehicle)
    until("flight", process, lambda: slots(place) > 300)
    process.send_signal(signal.SIGINT)
    assert end(process) == 130, (place / "said").read_text()
    last = [float(cell) for cell in rows(place)[-1][2:5]]
    run("run", "--resume", "run", "--no-viewer", *vehicle, cwd=place)
    same_files(place / "whole", place / "run", ["slots.csv"])
    assert json.loads((place / "begins").read_text().splitlines()[-1]) == last


def test_measured_energy_enters_the_run(place: Path) -> None:
    battery = ["--set", "uav.battery.capacity_j=100000.0"]
    fly(place, "skysink.ring.Flown(order.waypoint, energy_j=9e4 - 100 * order.slot)", *battery)
    assert [float(row[11]) for row in rows(place)] == [9e4 - 100.0 * (slot + 1) for slot in range(60)]
    for command in (["report", "run", "--sensors"], ["replay", "run", "--no-viewer"]):
        run(*command, cwd=place)
    fly(place, "skysink.ring.Flown(order.waypoint, energy_j=5.0)", "--force")
    assert len(rows(place)[0]) == 11, "the scenario has no battery"
    run("report", "run", cwd=place)


def test_the_altitude_returns_to_that_of_the_scenario(place: Path) -> None:
    fly(place, "order.waypoint - [0.0, 0.0, 0.3]")
    assert {row[4] for row in rows(place)} == {"19.7"}


def test_bits_do_not_count_in_a_hold(place: Path) -> None:
    fly(place, "skysink.ring.Flown(order.waypoint, bits={0: 10}, is_down=order.slot > 5)")
    assert [row[5] for row in rows(place)[:7]] == ["0"] * 5 + ["", ""]


def test_the_scenario_of_another_run_is_refused(place: Path) -> None:
    other = VEHICLE.format(returned="order.waypoint").replace("Mine())", f"Mine(), scenario={LETTER!r})")
    (place / "vehicle.py").write_text(other)
    command = f"{sys.executable} vehicle.py"
    said = run("run", SMOKE, "--no-viewer", "--vehicle", command, "--restart", "never", cwd=place, code=1).stderr
    assert "pass the scenario.toml of the run's folder" in said


def test_a_vehicle_in_a_paced_ring_knows_its_deadline_and_holds_on_late_plans(place: Path) -> None:
    (place / "vehicle.py").write_text("""
import time
import skysink.ring

class Mine(skysink.ring.Vehicle):
    def fly(self, order):
        left_s = order.ends_at - time.monotonic()
        print(order.slot, left_s, order.is_late, file=open("said.txt", "a"))
        time.sleep(max(0.0, left_s - 0.05))
        return order.waypoint

skysink.ring.vehicle(Mine())
""")
    vehicle = ["--vehicle", f"{sys.executable} vehicle.py", "--pace", "realtime", "--set", "slots=30"]
    run("run", "long.toml", "--no-viewer", "--out", "run", *vehicle, cwd=place)
    said = [line.split() for line in (place / "said.txt").read_text().splitlines()]
    assert [int(slot) for slot, _, _ in said] == list(range(1, 31))
    in_time = [float(left_s) for _, left_s, late in said if late == "False"]
    assert len(in_time) > 20 and np.median(in_time) > 0.05, "of slots of 0.1 s"
    late = sum(late == "True" for _, _, late in said)
    assert summary(place)["timing"]["missed_deadlines"] == late  # type: ignore[index]


def test_a_vehicle_can_be_started_by_hand(place: Path) -> None:
    (place / "vehicle.py").write_text(VEHICLE.format(returned="order.waypoint"))
    process = begin(place, "run", SMOKE, "--no-viewer", "--external", "flight-sim", "--out", "run")
    said = place / "said"
    until("ring", process, lambda: re.search(r"--ring (/\S+)", said.read_text()))
    refused = subprocess.run([sys.executable, "vehicle.py"], cwd=place, capture_output=True, text=True, timeout=60)
    assert "expected the folder of a running ring, or SKYSINK_RING from skysink run --vehicle" in refused.stderr
    vehicle = subprocess.Popen([sys.executable, "vehicle.py"], cwd=place, env=by_hand(place))
    assert vehicle.wait(60) == 0 and end(process) == 0, said.read_text()
    run("simulate", SMOKE, "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])
