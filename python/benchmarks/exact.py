"""Least losses of the small instances of the library, proven, and flights that reach them.

    python python/benchmarks/exact.py library/sks-small-5a.toml --plan plan.csv               # and a plan file
    python python/benchmarks/exact.py library/sks-small-5a.toml --replay runs/a/slots.csv     # checks the model here

One UAV on a grid (decision D17a) whose moves take a slot, links in free space, no weights. The model is computed here,
without Skysink: sample, overflow, upload (decision D1), in whole bits.

Dynamic programming over the slots: a label is a cell, the queues and the loss so far. It is dropped if another one at its
cell has no fuller queue and no larger loss, or if its loss plus what every sensor node (SN) still loses until the UAV can
be in range of it exceeds that of a known flight. As many SNs as possible are served, which never costs anything.

Exit codes: 0 done, 1 the replay disagrees, 2 an instance of another kind.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
import tomllib
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

WIDTH = 2000  # labels of the search for a first flight
OTHERS = (  # keys, tables and columns of other models
    "base no_fly building boundary_m arrivals energy expiry_s fading setup_s sharing duty_cycle noise_dbm_per_hz wind_mps"
    " acceleration_mps2 battery count must_land weight position_error_m service endurances_s"
)


@dataclass
class Instance:
    """Cells, ranges and bits of an instance."""

    name: str
    altitude_m: float
    cell_m: float
    middles_m: np.ndarray  # of cells, [cell, 2]
    neighbours: list[np.ndarray]  # of each cell: where a slot may end, itself included
    start: int
    blocks: int
    carried: np.ndarray  # bits that a slot carries, [cell, SN], -1 out of range
    arrivals: np.ndarray  # bits until the end of each slot, [slot, SN], from slot 0
    buffers: np.ndarray
    queues: np.ndarray  # before slot 1

    def sampled(self, slot: int, queues: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The queues after sampling and overflow, and the lost bits."""
        full = queues + self.arrivals[slot] - self.arrivals[slot - 1]
        return np.minimum(full, self.buffers), np.maximum(0, full - self.buffers).sum(axis=-1)


def read(path: Path) -> Instance:
    """Reads an instance; exits with code 2 if it is of another kind."""
    scenario = tomllib.loads(path.read_text())
    uav, link, area, fields = (scenario[table] for table in ("uav", "link", "area", "sensors"))
    rows = list(csv.DictReader((path.parent / fields["file"]).open()))

    def column(name: str) -> np.ndarray:
        return np.array([float(row.get(name) or fields.get(name) or link[name]) for row in rows])

    tau_s, cell_m = scenario["slot_s"], uav.get("cell_m", 10.0)
    found = set(OTHERS.split()) & {*scenario, *uav, *link, *area, *fields, *rows[0]}
    is_plain = (link["model"], link.get("gain", "static")) == ("free-space", "static") and "planner" not in scenario
    if found or not is_plain or uav.get("moves") != "grid" or cell_m > uav["max_speed_mps"] * tau_s:
        what = min(found, default="model, moves or objective")
        print(f"{path}: {what}: expected the loss on a grid in free space, and moves of a slot", file=sys.stderr)
        sys.exit(2)
    columns, lines = (int(area.get(key, area.get("side_m")) / cell_m + 1e-9) for key in ("width_m", "height_m"))
    cells = np.array([[x, y] for y in range(lines) for x in range(columns)])
    middles_m = (cells + 0.5) * cell_m
    d2_m2 = ((middles_m[:, None] - np.column_stack([column("x_m"), column("y_m")])) ** 2).sum(axis=2)
    snr = 10 ** (column("gain_db") / 10) * link["tx_power_w"] / 10 ** ((link["noise_dbm"] - 30) / 10)
    rates_bps = link["bandwidth_hz"] * np.log2(1 + snr / (uav["altitude_m"] ** 2 + d2_m2))  # UTS eq. 4
    is_near = d2_m2 <= (link["comm_radius_m"] * (1 + 1e-9)) ** 2  # decision D5
    times = np.arange(scenario["slots"] + 1)[:, None]
    return Instance(
        name=scenario["name"],
        altitude_m=uav["altitude_m"],
        cell_m=cell_m,
        middles_m=middles_m,
        neighbours=[np.flatnonzero(np.abs(cells - cell).sum(axis=1) <= 1) for cell in cells],
        start=int(np.argmin(((middles_m - uav["start_m"]) ** 2).sum(axis=1))),
        blocks=link["resource_blocks"],
        carried=np.where(is_near, np.floor(rates_bps * link["comm_s"]), -1).astype(np.int64),  # UTS eq. 7
        arrivals=np.floor(column("sampling_bps") * tau_s * times + 1e-9).astype(np.int64),  # decision D2
        buffers=column("capacity_bits").astype(np.int64),
        queues=column("queue_bits").astype(np.int64),
    )


class Search:
    """Dynamic programming over the slots; with ``width`` of the labels that look best only, which may miss the optimum."""

    def __init__(self, instance: Instance, limit: float = np.inf, width: int | None = None) -> None:
        self.instance, slots = instance, len(instance.arrivals) - 1
        steps = np.abs(instance.middles_m[:, None] - instance.middles_m).sum(axis=2) / instance.cell_m
        away = [steps[:, near].min(axis=1, initial=slots) for near in (instance.carried >= 0).T]
        self.away = np.array(away).T.round().astype(int)  # moves from a cell until an SN is in range
        cells, queues, losses = np.array([instance.start]), instance.queues[None], np.array([0])
        history: list[tuple[np.ndarray, ...]] = []
        for slot in range(1, slots + 1):
            cells, queues, losses, before, served = self.successors(slot, cells, queues, losses)
            bounds = losses + self.still_lost(slot, cells, queues)
            chosen = np.flatnonzero(bounds <= limit)
            if width is not None and len(chosen) > width:
                looks = bounds + (queues**2 / (4.0 * instance.buffers)).sum(axis=1)
                chosen = chosen[np.argsort(looks[chosen], kind="stable")[:width]]
            chosen = chosen[undominated(cells[chosen], np.column_stack([losses, queues])[chosen])]
            cells, queues, losses = cells[chosen], queues[chosen], losses[chosen]
            history.append((cells, before[chosen], served[chosen]))
        self.labels, label = max(len(cells) for cells, _, _ in history), int(np.argmin(losses))
        self.lost_bits, self.flight = int(losses[label]), list[tuple[int, list[int]]]()
        for cells, before, served in reversed(history):
            self.flight.insert(0, (int(cells[label]), np.flatnonzero(served[label]).tolist()))
            label = before[label]

    def successors(self, slot: int, cells: np.ndarray, queues: np.ndarray, losses: np.ndarray) -> list[np.ndarray]:
        """Cells, queues, losses, labels before and service of all labels after the slot."""
        queues, lost = self.instance.sampled(slot, queues)
        found = []
        for cell in np.unique(cells):
            at = np.flatnonzero(cells == cell)
            for end in self.instance.neighbours[cell]:
                near = np.flatnonzero(self.instance.carried[end] >= 0)
                for chosen in combinations(near, min(self.instance.blocks, len(near))):
                    served = np.isin(np.arange(queues.shape[1]), chosen)
                    rest = queues[at] - np.where(served, np.minimum(queues[at], self.instance.carried[end]), 0)
                    ends, all_served = np.full(len(at), end), np.tile(served, (len(at), 1))
                    found.append((ends, rest, losses[at] + lost[at], at, all_served))
        return [np.concatenate(parts) for parts in zip(*found, strict=True)]

    def still_lost(self, slot: int, cells: np.ndarray, queues: np.ndarray) -> np.ndarray:
        """Bits that are lost after the slot before the UAV can be in range of each SN, for all SNs together."""
        served = np.minimum(slot + np.maximum(self.away[cells], 1), len(self.instance.arrivals) - 1)
        arriving = np.take_along_axis(self.instance.arrivals, served, axis=0) - self.instance.arrivals[slot]
        return np.asarray(np.maximum(0, queues + arriving - self.instance.buffers).sum(axis=1))


def undominated(cells: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The rows of which no other one at the same cell is at most as large in every column."""
    found = []
    for cell in np.unique(cells):
        rest = np.flatnonzero(cells == cell)
        rest = rest[np.argsort(values[rest].sum(axis=1), kind="stable")]
        while len(rest):
            found.append(rest[0])
            rest = rest[(values[rest] < values[rest[0]]).any(axis=1)]
    return np.array(found, dtype=int)


def replayed(instance: Instance, flight: list[tuple[int, list[int]]]) -> list[tuple[int, int, int]]:
    """The delivered, lost and queued bits of each slot of a flight: the cell at its end, and the SNs that are served."""
    queues, ledger = instance.queues, []
    for slot, (cell, served) in enumerate(flight, 1):
        queues, lost = instance.sampled(slot, queues)
        sent = np.minimum(queues[served], instance.carried[cell, served])
        queues[served] -= sent
        ledger.append((int(sent.sum()), int(lost), int(queues.sum())))
    return ledger


def compare(instance: Instance, path: Path) -> int:
    """Replays the flight of a run's slots.csv, and returns how many slots have another ledger."""
    flight, flown = [], []
    for row in csv.DictReader(path.open()):
        away = ((instance.middles_m - [float(row["x_m"]), float(row["y_m"])]) ** 2).sum(axis=1)
        flight.append((int(np.argmin(away)), [int(sensor) for sensor in row["scheduled"].split()]))
        flown.append(tuple(int(row[f"{what}_bits"]) for what in ("delivered", "lost", "queued")))
    differing = sum(one != other for one, other in zip(replayed(instance, flight), flown, strict=True))
    print(f"{instance.name}: {len(flown)} slots, {differing} differ")
    return differing


def plan_file(instance: Instance, flight: list[tuple[int, list[int]]]) -> str:
    """The flight as `skysink library verify` reads it."""
    text = f"# instance: {instance.name}\nslot,uav,x_m,y_m,z_m,scheduled\n"
    for slot, (cell, served) in enumerate(flight, 1):
        x_m, y_m = instance.middles_m[cell].tolist()
        text += f"{slot},0,{x_m},{y_m},{instance.altitude_m},{' '.join(map(str, served))}\n"
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instance", type=Path)
    parser.add_argument("--plan", type=Path, help="the plan file to write")
    parser.add_argument("--replay", type=Path, metavar="SLOTS", help="compare the ledger of a run's slots.csv instead")
    arguments = parser.parse_args()
    instance = read(arguments.instance)
    if arguments.replay:
        return int(compare(instance, arguments.replay) > 0)
    begin = time.perf_counter()
    best = Search(instance, limit=Search(instance, width=WIDTH).lost_bits)
    took_s = time.perf_counter() - begin
    rate = best.lost_bits / int(instance.arrivals[-1].sum())
    print(f"{instance.name}: optimum {best.lost_bits} bit, loss rate {rate:.6f}, {took_s:.1f} s, {best.labels} labels")
    assert sum(lost for _, lost, _ in replayed(instance, best.flight)) == best.lost_bits
    if arguments.plan:
        arguments.plan.write_text(plan_file(instance, best.flight))
    return 0


if __name__ == "__main__":
    sys.exit(main())
