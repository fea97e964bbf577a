"""Reads a run folder of `skysink simulate` as slots to plan again: the position of the UAV and all queues.

It recomputes the ledger of the run in whole bits, and refuses a run whose columns differ.
Planning is left to `peers.py`. Positions are complex numbers, x + iy [m]. Decisions Dn are those of docs/src/model.md.
"""

from __future__ import annotations

import csv
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Places = NDArray[np.complex128]
Ids = NDArray[np.int64]
Bits = NDArray[np.int64]

RANGE_SLACK = 1e-9  # of decision D5, relative to the radius


class BadRun(Exception):
    """The run cannot be compared, for the reason in the message."""


@dataclass(frozen=True)
class Field:
    """The constant data: the sensor nodes (SNs), their links and the limits of the UAV."""

    places: Places  # L_i
    gains: Reals  # α_i, linear
    pairs: NDArray[np.bool_]  # N x N: within 2 d_c of each other, and not the same SN
    corner: complex  # of the area, opposite to the origin
    reach_m: float  # V τ
    comm_radius_m: float  # d_c
    blocks: int  # n
    altitude_m: float  # H
    bandwidth_hz: float  # W
    snr_per_gain: float  # p/σ²
    comm_s: float  # τ_c


@dataclass(frozen=True)
class Slot:
    """The state before a slot, and the flight by Skysink."""

    number: int
    uav: complex  # L_u(t−1)
    queues: Bits  # B_i(t−1)
    served: list[int]
    waypoint: complex
    mode: str


@dataclass(frozen=True)
class Run:
    """A run whose slots can be planned again."""

    name: str
    waypoint_solver: str
    field: Field
    slots: list[Slot]
    plan_p50_us: float
    plan_p99_us: float


def squared(distance: Places) -> Reals:
    """‖d‖² [m²]."""
    return distance.real * distance.real + distance.imag * distance.imag


def within(a: Places | complex, b: Places | complex, radius_m: float | Reals) -> NDArray[np.bool_]:
    """Decision D5: at most `radius_m` apart, with a slack that includes SNs on the circle."""
    return squared(np.asarray(a - b)) <= (radius_m * (1 + RANGE_SLACK)) ** 2


def read_run(folder: Path) -> Run:
    """Reads the run in `folder` and recomputes its ledger.

    Raises BadRun for a run without the required data, or whose ledger differs.
    """
    scenario = tomllib.loads((folder / "scenario.toml").read_text(encoding="utf-8"))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    refuse_others(folder, scenario, summary)
    sensors, lines = read_csv(folder / "sensors.csv"), read_csv(folder / "slots.csv")
    field = field_of(scenario, sensors)
    return Run(
        name=f"{summary['name']}, seed {summary['seed']}",
        waypoint_solver=scenario["planner"]["waypoint_solver"],
        field=field,
        slots=replay(field, scenario, sensors, lines),
        plan_p50_us=summary["timing"]["plan_p50_us"],
        plan_p99_us=summary["timing"]["plan_p99_us"],
    )


def refuse_others(folder: Path, scenario: dict[str, Any], summary: dict[str, Any]) -> None:
    """Accepts only runs of Algorithm 1 without refusals, over links that sensors.csv determines."""
    expected = [
        ("planner.strategy", scenario["planner"]["strategy"], "uts"),
        ("planner.sca_iterations", scenario["planner"]["sca_iterations"], 1),
        ("planner.knowledge", scenario["planner"]["knowledge"], "oracle"),
        ("link.model", scenario["link"]["model"], "free-space"),
        ("link.gain", scenario["link"]["gain"], "static"),
        ("held_slots", summary["held_slots"], 0),
        ("refused", summary["refused"], 0),
        ("resumed_after", summary["resumed_after"], None),
    ]
    for key, found, wanted in expected:
        if found != wanted:
            raise BadRun(f"run {folder}: {key} = {found}: expected {wanted}, anything else cannot be compared")


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def field_of(scenario: dict[str, Any], sensors: list[dict[str, str]]) -> Field:
    area, uav, link = scenario["area"], scenario["uav"], scenario["link"]
    places = np.array([complex(float(sensor["x_m"]), float(sensor["y_m"])) for sensor in sensors])
    side_m = area.get("side_m")
    return Field(
        places=places,
        gains=np.array([10.0 ** (float(sensor["gain_db"]) / 10.0) for sensor in sensors]),
        pairs=within(places[:, None], places, 2 * link["comm_radius_m"]) & ~np.eye(len(places), dtype=bool),
        corner=complex(side_m, side_m) if side_m else complex(area["width_m"], area["height_m"]),
        reach_m=uav["max_speed_mps"] * scenario["slot_s"],
        comm_radius_m=link["comm_radius_m"],
        blocks=link["resource_blocks"],
        altitude_m=uav["altitude_m"],
        bandwidth_hz=link["bandwidth_hz"],
        snr_per_gain=link["tx_power_w"] / 10.0 ** ((link["noise_dbm"] - 30.0) / 10.0),
        comm_s=link["comm_s"],
    )


def replay(
    field: Field, scenario: dict[str, Any], sensors: list[dict[str, str]], lines: list[dict[str, str]]
) -> list[Slot]:
    """The state before every slot, by the order of decision D1: sample, overflow, upload."""
    mean_bits = np.array([float(sensor["sampling_bps"]) for sensor in sensors]) * scenario["slot_s"]
    queues = np.array([int(sensor["queue_bits"]) for sensor in sensors], dtype=np.int64)
    sampled = np.zeros_like(queues)
    uav = complex(*scenario["uav"]["start_m"])
    slots = []
    for number, line in enumerate(lines, start=1):
        served = [int(sensor) for sensor in line["scheduled"].split()]
        waypoint = complex(float(line["x_m"]), float(line["y_m"]))
        slots.append(Slot(number, uav, queues, served, waypoint, line["mode"]))

        sampled_before, sampled = sampled, np.floor(mean_bits * number + 1e-9).astype(np.int64)  # decision D2
        filled = queues + (sampled - sampled_before)
        queues = np.minimum(filled, scenario["sensors"]["capacity_bits"])
        uploaded = np.minimum(capacity_bits(field, served, waypoint), queues[served])
        lost = filled - queues
        queues[served] -= uploaded
        books = (("delivered_bits", uploaded), ("lost_bits", lost), ("queued_bits", queues))
        for column, bits in books:
            if int(bits.sum()) != int(line[column]):
                raise BadRun(f"slot {number}: {column} = {line[column]}, but the books of the replay say {bits.sum()}")
        uav = waypoint
    return slots


def capacity_bits(field: Field, served: list[int], waypoint: complex) -> Bits:
    """Bits that each link carries in a slot, floor(r_i τ_c), with the rate of UTS eq. 4."""
    x_m2 = field.altitude_m**2 + squared(field.places[served] - waypoint)
    snr = field.gains[served] * field.snr_per_gain / x_m2
    return np.floor(field.bandwidth_hz * np.log2(1 + snr) * field.comm_s).astype(np.int64)
