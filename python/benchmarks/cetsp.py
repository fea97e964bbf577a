"""Rounds over disks on instances of the close-enough travelling salesman problem, against the best known tours.

    python python/benchmarks/cetsp.py instances.json                 # a second for each round, and one for its bound
    python python/benchmarks/cetsp.py instances.json --seconds 0.1 --only rat195
    python python/benchmarks/cetsp.py instances.json --seconds 1 10 100 --seeds 10 10 2     # means over seeds, by time
    python python/benchmarks/cetsp.py instances.json --flown         # what the strategy tour flies, instead
    python python/benchmarks/cetsp.py instances.json --uavs 2 3 5    # several rounds from the depot, the longest as short as found

The file maps names to instances: {"name": {"radius": 10, "depot": [x, y], "nodes": [[x, y], ...], "best": length}}, where
best is the length of the best known closed tour, and the radius above 0. For those in cetsp_published.json the least tour of
three public sources is taken instead, and their published lower bound is shown. With --flown a way need not return, so that it may be
shorter than the best known tour. None comes with Skysink: docs/src/rounds.md says where they are published.
`skysink-cetsp` in PATH finds the rounds and bounds: cargo build --release -p skysink-cetsp.
The exit code is 1 if a round misses a disk, if a bound is above a best known tour, or if tour does not serve all in time.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from statistics import mean, median
from typing import Any

import numpy as np

SOLVER = "skysink-cetsp"
ROUNDED = 1e-5  # the best known lengths are rounded
STEPS = 300  # of each of several rounds
PUBLISHED = Path(__file__).with_name("cetsp_published.json")
LEGS = 4000  # slots in which a mission flies the best known length


class Solver:
    """The program that finds rounds: a line in, a line out."""

    def __init__(self) -> None:
        self.process = subprocess.Popen([SOLVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def solve(
        self, instance: dict[str, Any], round: dict[str, float], bound: dict[str, float] | None = None, seed: int = 0
    ) -> Round:
        """A closed round from the depot that touches the disks of the instance."""
        asked = {
            "centres_m": np.asarray(instance["nodes"], float).tolist(),
            "radius_m": instance["radius"],
            "start_m": instance["depot"],
            "is_closed": True,
            "seed": seed,
            "round": round,
            "bound": bound,
        }
        assert self.process.stdin and self.process.stdout
        print(json.dumps(asked), file=self.process.stdin, flush=True)
        answer = json.loads(self.process.stdout.readline())
        return Round(np.array(answer["points_m"]), answer["order"], answer["length_m"], answer["bound_m"])


@dataclass
class Round:
    """A round: its points, the disk of each after the depot, its length, and a bound on that of every round."""

    points_m: np.ndarray
    order: list[int]
    length_m: float
    bound_m: float | None


def away(centres: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The distance of each centre from the closed path over the points."""
    begin, to = points, np.roll(points, -1, axis=0)
    along = to - begin
    squares = np.maximum((along**2).sum(axis=1), 1e-300)
    fractions = np.clip(((centres[:, None] - begin) * along).sum(axis=2) / squares, 0.0, 1.0)
    distances: np.ndarray = np.linalg.norm(begin + fractions[..., None] * along - centres[:, None], axis=2)
    return np.asarray(distances.min(axis=1))


def missed(instance: dict[str, Any], *rounds: np.ndarray) -> float:
    """How far the disk that is farthest from the closed paths lies beyond its radius, in radii."""
    centres = np.array(instance["nodes"], float)
    return float(np.min([away(centres, points) for points in rounds], axis=0).max() / instance["radius"] - 1.0)


class Rounds:
    """Closed rounds from the depot that touch all disks together, the longest as short as found in ``seconds``.

    Route first, cluster second: the round over all disks is cut where the longest piece, with its ways from and to the depot,
    is shortest. Then disks move from the longest round to the one that passes nearest, as long as that makes the longest shorter.
    """

    def __init__(self, solver: Solver, instance: dict[str, Any], uavs: int, seconds: float) -> None:
        end = time.perf_counter() + seconds
        self.solver, self.instance, self.centres = solver, instance, np.array(instance["nodes"], float)
        whole = solver.solve(instance, {"seconds": seconds / 4}, {"seconds": seconds / 4})
        assert whole.bound_m is not None
        depot = np.array(instance["depot"], float)
        farthest = np.linalg.norm(self.centres - depot, axis=1).max() - instance["radius"]
        self.bound = max(whole.bound_m / uavs, 2.0 * farthest)
        begins = cut(whole.points_m[1:], depot, uavs)
        ends = [*begins[1:], len(whole.order)]
        pieces = [np.vstack([depot, whole.points_m[1 + a : 1 + b]]) for a, b in zip(begins, ends, strict=True)]
        self.group = np.argmin([away(self.centres, piece) for piece in pieces], axis=0)
        self.rounds = [self.solve(self.group == uav) for uav in range(uavs)]
        random = np.random.default_rng(1)
        while time.perf_counter() < end and self.longest > self.bound * (1.0 + ROUNDED):
            self.move(random)

    @property
    def longest(self) -> float:
        return max(one.length_m for one in self.rounds)

    def solve(self, chosen: np.ndarray) -> Round:
        return self.solver.solve({**self.instance, "nodes": self.centres[chosen]}, {"steps": STEPS})

    def move(self, random: np.random.Generator) -> None:
        """Moves some of the disks of the longest round that lie together to the round that is nearest to one of them."""
        lengths = [one.length_m for one in self.rounds]
        worst = int(np.argmax(lengths))
        own = np.flatnonzero(self.group == worst)
        first = self.centres[random.choice(own)]
        count = min(1 + random.geometric(0.2), len(own))
        moved = own[np.argsort(np.linalg.norm(self.centres[own] - first, axis=1))[:count]]
        reach = [np.inf if uav == worst else away(first[None], one.points_m)[0] for uav, one in enumerate(self.rounds)]
        to = random.choice(np.argsort(reach)[: min(2, len(reach) - 1)])
        group = self.group.copy()
        group[moved] = to
        both = {uav: self.solve(group == uav) for uav in (worst, to)}
        if max(one.length_m for one in both.values()) < lengths[worst]:
            self.group = group
            for uav, one in both.items():
                self.rounds[uav] = one


def cut(points: np.ndarray, depot: np.ndarray, pieces: int) -> list[int]:
    """Where the pieces of a path begin whose longest, with its ways from and to the depot, is shortest."""
    ways = np.linalg.norm(points - depot, axis=1)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))

    def begins(longest: float) -> list[int]:
        found = [0]
        for end in range(1, len(points)):
            if ways[found[-1]] + along[end] - along[found[-1]] + ways[end] > longest:
                found.append(end)
        return found

    low, high = 2.0 * ways.max(initial=0.0), 2.0 * ways.max(initial=0.0) + along[-1]
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (low, middle) if len(begins(middle)) <= pieces else (middle, high)
    found = begins(high)
    return found + [len(points)] * (pieces - len(found))


def flown(instance: dict[str, Any]) -> float:
    """The way in slots until the strategy tour has served all disks, ends of slots alone, in best known lengths.

    It need not return, and with 64 resource blocks it serves all in range.
    """
    import skysink

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


def with_published(instances: dict[str, Any]) -> dict[str, Any]:
    """The instances with the least published tours, and the published bounds."""
    published = json.loads(PUBLISHED.read_text())["instances"]

    def known(name: str, one: dict[str, Any]) -> dict[str, Any]:
        row = published.get(name)
        return {**one, "best": row["least_published"], "bound": row["published_lower_bound"]} if row else one

    return {name: known(name, one) for name, one in instances.items()}


def several(solver: Solver, instances: dict[str, Any], uavs: list[int], seconds: float) -> int:
    """Prints the longest of several rounds, over the best known round and over the lower bound, and returns the exit code."""
    print("| instance |" + "".join(f" U = {count} | ÷ bound |" for count in uavs))
    print("|---|" + "---|---|" * len(uavs))
    ratios: dict[int, list[float]] = {count: [] for count in uavs}
    gaps: dict[int, list[float]] = {count: [] for count in uavs}
    failed = []
    for name, one in sorted(instances.items()):
        row = f"| {name} |"
        for count in uavs:
            found = Rounds(solver, one, count, seconds)
            ratios[count].append(found.longest / one["best"])
            gaps[count].append(found.longest / found.bound)
            row += f" {ratios[count][-1]:.3f} | {gaps[count][-1]:.3f} |"
            if missed(one, *(each.points_m for each in found.rounds)) > 1e-9 or gaps[count][-1] < 1.0 - ROUNDED:
                failed.append(f"{name}, {count} UAVs")
        print(row, flush=True)
    print()
    for count in uavs:
        print(f"U = {count}: longest ÷ best known median {median(ratios[count]):.3f}, ÷ bound median {median(gaps[count]):.3f}")
    for name in failed:
        print(f"{name}: a disk is missed, or the bound is above the longest round", file=sys.stderr)
    return int(bool(failed))


def single(solver: Solver, instances: dict[str, Any], seeds: dict[float, int], bound_s: float) -> int:
    """Prints the lengths of rounds by the time of the search, means over seeds, and returns the exit code.

    Where the rounds of all seeds are proven optimal, longer searches are left out, and their column repeats the mean.
    """
    lengths = [f"{time_s:g} s ÷ best known" for time_s in seeds]
    heads = ["instance", "disks", "points", *lengths, "least ÷", "bound ÷ best known", "published bound ÷"]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    ratios: dict[float, list[float]] = {time_s: [] for time_s in seeds}
    bounds, failed = [], []
    for name, one in sorted(instances.items()):
        proven = one.get("bound", 0.0) / one["best"] > 1.0 - ROUNDED
        found: list[Round] = []
        for time_s, count in seeds.items():
            if not found or not proven or max(ratio_of_seeds) > 1.0 + ROUNDED:
                bound = {"seconds": bound_s} if not found else None
                runs = [solver.solve(one, {"seconds": time_s}, None if seed else bound, seed) for seed in range(count)]
                ratio_of_seeds = [run.length_m / one["best"] for run in runs]
                found += runs
            ratios[time_s].append(mean(ratio_of_seeds))
        assert found[0].bound_m is not None
        best = min(found, key=lambda run: run.length_m)
        bounds.append(found[0].bound_m / one["best"])
        published = f"{one['bound'] / one['best']:.4f}" if "bound" in one else ""
        cells = [name, len(one["nodes"]), len(best.order), *(f"{ratios[time_s][-1]:.4f}" for time_s in seeds)]
        cells += [f"{best.length_m / one['best']:.4f}", f"{bounds[-1]:.4f}", published]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
        least = min(one["best"], best.length_m)
        if any(missed(one, run.points_m) > 1e-9 for run in found) or found[0].bound_m > least * (1.0 + ROUNDED):
            failed.append(name)
    print()
    for time_s, count in seeds.items():
        values = ratios[time_s]
        figures = f"median {median(values):.4f}, mean {mean(values):.4f}, worst {max(values):.4f}"
        print(f"{time_s:g} s, seeds 0 to {count - 1}: {figures}")
    print(f"bound: median {median(bounds):.3f}, mean {mean(bounds):.3f}, least {min(bounds):.3f}")
    for name in failed:
        print(f"{name}: a disk is missed, or the bound is above the best known tour", file=sys.stderr)
    return int(bool(failed))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seconds", type=float, nargs="+", default=[1.0], help="for a round; for several rounds in all")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="searches of a round, for each of --seconds")
    parser.add_argument("--bound", type=float, default=1.0, metavar="SECONDS", help="for the bound")
    parser.add_argument("--only", default="", help="instances whose names contain this")
    parser.add_argument("--flown", action="store_true", help="the way that the strategy tour flies until all are served")
    parser.add_argument("--uavs", type=int, nargs="+", default=[], help="several rounds, the longest of which counts")
    arguments = parser.parse_args()
    instances = {name: one for name, one in json.loads(arguments.file.read_text()).items() if arguments.only in name}
    instances = with_published(instances)
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
    if len(set(arguments.seconds)) < len(arguments.seconds) or min(arguments.seeds) < 1:
        parser.error("--seconds, --seeds: expected different times, and numbers from 1 on")
    if (arguments.uavs or arguments.flown) and [len(arguments.seconds), arguments.seeds] != [1, [1]]:
        parser.error("--uavs, --flown: expected one of --seconds, and no --seeds")
    if min(arguments.uavs, default=2) < 2:
        parser.error("--uavs: expected numbers from 2 on")
    if not which(SOLVER):
        print(f"{SOLVER}: not found: expected it in PATH (cargo build --release -p skysink-cetsp)", file=sys.stderr)
        return 1
    solver = Solver()
    if arguments.uavs:
        return several(solver, instances, arguments.uavs, arguments.seconds[0])
    seeds = arguments.seeds * len(arguments.seconds) if len(arguments.seeds) == 1 else arguments.seeds
    if len(seeds) != len(arguments.seconds):
        parser.error("--seeds: expected one number, or one for each of --seconds")
    return single(solver, instances, dict(zip(arguments.seconds, seeds, strict=True)), arguments.bound)


if __name__ == "__main__":
    sys.exit(main())
