"""Rounds over disks on instances of the close-enough travelling salesman problem, against the best known tours.

    python python/benchmarks/cetsp.py instances.json                 # a second for each round, and one for its bound
    python python/benchmarks/cetsp.py instances.json --seconds 0.1 --only rat195
    python python/benchmarks/cetsp.py instances.json --flown         # what the strategy tour flies, instead

The file maps names to instances: {"name": {"radius": 10, "depot": [x, y], "nodes": [[x, y], ...], "best": length}}, where
best is the length of the best known closed tour, and the radius above 0. With --flown a way need not return, so that it may be
shorter than the best known tour. None comes with Skysink: docs/src/rounds.md says where they are published.
The exit code is 1 if a round misses a disk, if a bound is above a best known tour, or if tour does not serve all in time.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import skysink

ROUNDED = 1e-5  # the best known lengths are rounded
LEGS = 4000  # slots in which a mission flies the best known length


def missed(instance: dict[str, Any], points: np.ndarray) -> float:
    """How far the disk that is farthest from the closed path lies beyond its radius, in radii."""
    begin, to = points, np.roll(points, -1, axis=0)
    along = to - begin
    squares = np.maximum((along**2).sum(axis=1), 1e-300)
    worst = 0.0
    for centre in np.asarray(instance["nodes"]):
        fraction = np.clip(((centre - begin) * along).sum(axis=1) / squares, 0.0, 1.0)
        away = np.linalg.norm(begin + fraction[:, None] * along - centre, axis=1).min()
        worst = max(worst, away / instance["radius"] - 1.0)
    return worst


def flown(instance: dict[str, Any]) -> float:
    """The way in slots until the strategy tour has served all disks, ends of slots alone, in best known lengths.

    It need not return, and with 64 resource blocks it serves all in range.
    """
    points = np.array([*instance["nodes"], instance["depot"]], float)
    points -= points.min(axis=0)
    width, height = np.maximum(points.max(axis=0), 1e-3)
    with tempfile.TemporaryDirectory() as folder:
        lines = "".join(f"{x!r},{y!r},1\n" for x, y in points[:-1].tolist())
        Path(folder, "disks.csv").write_text(f"x_m,y_m,sampling_bps\n{lines}")
        Path(folder, "mission.toml").write_text(
            f"name = 'cetsp'\nslots = {2 * LEGS}\n[area]\nwidth_m = {width}\nheight_m = {height}\n"
            f"[sensors]\nfile = 'disks.csv'\n[link]\ncomm_radius_m = {float(instance['radius'])}\nresource_blocks = 64\n"
            f"[uav]\nstart_m = {points[-1].tolist()}\nendurance_s = {2.0 * LEGS}\nmax_speed_mps = {instance['best'] / LEGS}\n"
        )
        run = skysink.simulate(skysink.Scenario.load(Path(folder, "mission.toml")), "tour")
    left = set(range(len(instance["nodes"])))
    for slots, served in enumerate(run.slots["scheduled"], 1):
        left.difference_update(served)
        if not left:
            return slots / LEGS
    return float("inf")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seconds", type=float, default=1.0, help="for the round, and for the bound")
    parser.add_argument("--only", default="", help="instances whose names contain this")
    parser.add_argument("--flown", action="store_true", help="the way that the strategy tour flies until all are served")
    arguments = parser.parse_args()
    instances = {name: one for name, one in json.loads(arguments.file.read_text()).items() if arguments.only in name}
    if not instances:
        print(f"no instance of {arguments.file} has {arguments.only!r} in its name", file=sys.stderr)
        return 1
    if arguments.flown:
        ways = {name: flown(one) for name, one in sorted(instances.items())}
        print("| instance | flown ÷ best known |\n|---|---|")
        print("".join(f"| {name} | {way:.3f} |\n" for name, way in ways.items()))
        late = [name for name, way in ways.items() if way == float("inf")]
        print(f"flown: median {median(ways.values()):.3f}, mean {mean(ways.values()):.3f}, worst {max(ways.values()):.3f}")
        for name in late:
            print(f"{name}: tour does not serve all disks within {2 * LEGS} slots", file=sys.stderr)
        return int(bool(late))
    print("| instance | disks | points | length ÷ best known | bound ÷ best known | time [s] |\n|---|---|---|---|---|---|")
    ratios, bounds, failed = [], [], []
    for name, one in sorted(instances.items()):
        begin = time.perf_counter()
        found = skysink.round_over_disks(np.array(one["nodes"], float), one["radius"], one["depot"], seconds=arguments.seconds)
        took = time.perf_counter() - begin
        ratio, bound = found.length_m / one["best"], found.bound_m / one["best"]
        print(f"| {name} | {len(one['nodes'])} | {len(found.order)} | {ratio:.4f} | {bound:.4f} | {took:.2f} |", flush=True)
        ratios.append(ratio)
        bounds.append(bound)
        if missed(one, found.points_m) > 1e-9 or bound > 1.0 + ROUNDED:
            failed.append(name)
    print(f"\nlength: median {median(ratios):.4f}, mean {mean(ratios):.4f}, worst {max(ratios):.4f}")
    print(f"bound: median {median(bounds):.3f}, mean {mean(bounds):.3f}, least {min(bounds):.3f}")
    for name in failed:
        print(f"{name}: a disk is missed, or the bound is above the best known tour", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
