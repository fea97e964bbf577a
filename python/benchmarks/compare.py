"""Plans the slots of Skysink's missions again with common research tools: checks the plans, and compares the times.

    python python/benchmarks/compare.py                          # flies letter and link-limited with target/release/skysink
    python python/benchmarks/compare.py runs/letter-uts-1        # an existing run

Every peer plans every slot from the same state as Skysink. The exit code is 1 if a peer serves other sensor nodes or has
another waypoint, and 2 if a run cannot be compared. Times are of whole plans, schedule and waypoint: wall-clock times of
Skysink from its summary; CPU times of the peers, so that a busy machine does not affect them.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from time import process_time_ns

import clarabel
import cvxpy as cp
import numpy as np

import peers
from replay import BadRun, Reals, Run, Slot, read_run

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = [ROOT / "scenarios" / name for name in ("letter.toml", "link-limited.toml")]
FLIGHTS = 9  # of a scenario, for Skysink's times
EXACT_M = 1e-9  # allowed between two exact waypoints [m]
CONIC_M = 1e-3  # allowed between an interior-point waypoint and any other [m]
SHOWN = 3  # disagreements printed per peer
WIDTHS = (14, 10, 11, 8, 19, 14)  # of the table's columns


@dataclass(frozen=True)
class Peer:
    """A solver of sP2*; the schedule is common to all."""

    name: str
    solver: Callable[[], peers.Solver]
    tolerance_m: float


PEERS = [
    Peer("NumPy", lambda: peers.solve_numpy, EXACT_M),
    Peer("Clarabel, kept", peers.KeptClarabel, CONIC_M),
    Peer("CVXPY, built once", peers.KeptCvxpy, CONIC_M),
    Peer("CVXPY, built per slot", lambda: peers.solve_cvxpy_anew, CONIC_M),
]


@dataclass(frozen=True)
class Outcome:
    """The results of a peer: times per plan and of its waypoint [µs], distances to Skysink's waypoints [m]."""

    plans_us: Reals
    waypoints_us: Reals
    off_m: Reals
    disagreements: list[str]


def fly(skysink: Path, scenario: Path) -> Run:
    """Flies a scenario. Its times are medians over several flights, each of which takes milliseconds only."""
    with tempfile.TemporaryDirectory() as folder:
        runs = []
        for flight in range(FLIGHTS):
            out = Path(folder) / str(flight)
            command = [str(skysink), "simulate", str(scenario), "--strategy", "uts", "--out", str(out)]
            flown = subprocess.run(command, capture_output=True, text=True, check=False)
            if flown.returncode != 0:
                raise BadRun(flown.stderr.strip() or f"{skysink} ended with exit code {flown.returncode}")
            runs.append(read_run(out))
    p50_us = median(run.plan_p50_us for run in runs)
    p99_us = median(run.plan_p99_us for run in runs)
    return replace(runs[0], plan_p50_us=p50_us, plan_p99_us=p99_us)


def measure(peer: Peer, run: Run, slots: list[Slot]) -> Outcome:
    """Plans `slots` with a peer, each once, after a warm-up with a slot of every problem size."""
    solve = peer.solver()
    waypoint_ns = 0

    def timed(problem: peers.Expansion) -> complex | None:
        nonlocal waypoint_ns
        begin_ns = process_time_ns()
        waypoint = solve(problem)
        waypoint_ns = process_time_ns() - begin_ns
        return waypoint

    one_per_size = {len(slot.served): slot for slot in slots}
    for slot in one_per_size.values():
        peers.plan(run.field, slot.uav, slot.queues, solve)
    times_ns, off_m, disagreements = [], [], []
    exact = run.waypoint_solver == "geometric"
    for slot in slots:
        waypoint_ns = 0
        begin_ns = process_time_ns()
        plan = peers.plan(run.field, slot.uav, slot.queues, timed)
        times_ns.append((process_time_ns() - begin_ns, waypoint_ns))
        off_m.append(abs(plan.waypoint - slot.waypoint))
        served = plan.served.tolist()
        if (served, plan.mode) != (slot.served, slot.mode):
            disagreements.append(f"slot {slot.number}: {plan.mode} {served}, Skysink {slot.mode} {slot.served}")
        elif not off_m[-1] <= (peer.tolerance_m if exact else CONIC_M):
            disagreements.append(f"slot {slot.number}: waypoint {off_m[-1]:.1e} m from Skysink's")
    plans_us, waypoints_us = np.array(times_ns).T / 1e3
    return Outcome(plans_us, waypoints_us, np.array(off_m), disagreements)


def compare(run: Run, limit: int | None) -> bool:
    """Prints the table of a run. Returns whether all agree."""
    slots = run.slots[:limit]
    print(f"\n{run.name}: {len(slots)} of {len(run.slots)} slots, N = {len(run.field.places)}")
    columns = ["plan p50 [µs]", "p99 [µs]", "ratio p50", "p99", "waypoint p50 [µs]", "farthest [m]"]
    print(row("", columns))
    skysink = f"Skysink, {run.waypoint_solver}"
    print(row(skysink, [f"{run.plan_p50_us:.1f}", f"{run.plan_p99_us:.1f}", "1", "1", "", ""]))
    agreed = True
    for peer in PEERS:
        outcome = measure(peer, run, slots)
        p50_us, p99_us = np.percentile(outcome.plans_us, [50, 99], method="inverted_cdf")
        ratios = [f"{p50_us / run.plan_p50_us:.1f}", f"{p99_us / run.plan_p99_us:.1f}"]
        waypoint_us = f"{np.median(outcome.waypoints_us):.0f}"
        print(row(peer.name, [f"{p50_us:.0f}", f"{p99_us:.0f}", *ratios, waypoint_us, f"{outcome.off_m.max():.1e}"]))
        for disagreement in outcome.disagreements[:SHOWN]:
            print(f"  DISAGREES in {len(outcome.disagreements)} slots: {disagreement}")
        agreed &= not outcome.disagreements
    return agreed


def row(name: str, cells: list[str]) -> str:
    return f"{name:<24}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, WIDTHS, strict=True))


def main() -> int:
    parser = argparse.ArgumentParser(description="Plan the slots of a run with NumPy, Clarabel and CVXPY, and compare.")
    parser.add_argument("runs", nargs="*", type=Path, default=SCENARIOS, help="run folders, or scenarios to fly")
    parser.add_argument("--skysink", type=Path, default=ROOT / "target/release/skysink", help="what flies scenarios")
    parser.add_argument("--slots", type=int, help="plan the first SLOTS slots only; the books are kept for all")
    arguments = parser.parse_args()
    if arguments.slots is not None and arguments.slots < 1:
        parser.error(f"--slots {arguments.slots}: expected at least 1")
    if not arguments.skysink.is_file() and not all(source.is_dir() for source in arguments.runs):
        parser.error(f"--skysink {arguments.skysink}: no such file; cargo build --release makes target/release/skysink")
    versions = f"NumPy {np.__version__}, CVXPY {cp.__version__}, Clarabel {clarabel.__version__}"
    print(f"Python {platform.python_version()}, {versions}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    agreed = True
    try:
        for source in arguments.runs:
            run = read_run(source) if source.is_dir() else fly(arguments.skysink, source)
            agreed &= compare(run, arguments.slots)
    except (BadRun, OSError) as error:
        print(f"compare.py: {error}", file=sys.stderr)
        return 2
    print("\nAll plans agree." if agreed else "\nPlans disagree.")
    return 0 if agreed else 1


if __name__ == "__main__":
    sys.exit(main())
