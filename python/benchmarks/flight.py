"""Compares the time of a slot in Python and on the command line: missions in one process, and planners in the ring.

    python python/benchmarks/flight.py                  # about a minute

Both fly the same mission alternately; the medians of the times in summary.json are printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import skysink

ROOT = Path(__file__).resolve().parents[2]
COMMAND = str(Path(sys.executable).with_name("skysink"))
SLOTS = {"slots": 20_000, "uav.endurance_s": 1e6}


def by_command(place: Path, *arguments: str) -> dict[str, Any]:
    """The summary of a mission flown by the command line."""
    settings = [f"--set={key}={value}" for key, value in SLOTS.items()]
    words = [COMMAND, *arguments, *settings, "--out", str(place / "run"), "--force"]
    subprocess.run(words, check=True, capture_output=True)
    summary: dict[str, Any] = json.loads((place / "run" / "summary.json").read_text())
    return summary


def main() -> int:
    parser = argparse.ArgumentParser(description="Compares the time of a slot in Python and on the command line.")
    parser.add_argument("--repetitions", type=int, default=7, help="of each, in turn [default: 7]")
    repetitions = parser.parse_args().repetitions
    letter = str(ROOT / "scenarios" / "letter.toml")
    scenario = skysink.Scenario.load(letter).replace(SLOTS)
    planner = f"{sys.executable} {ROOT / 'examples' / 'ring_planner.py'}"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        in_ring = [letter, "--strategy", "gfs", "--no-viewer"]
        flights: dict[str, Callable[[], float]] = {
            "simulate, command line": lambda: 1e6 / by_command(place, "simulate", letter)["timing"]["slots_per_s"],
            "simulate, Python": lambda: 1e6 / skysink.simulate(scenario).summary["timing"]["slots_per_s"],
            "ring, planner of Skysink": lambda: slot_us(by_command(place, "run", *in_ring)),
            "ring, planner in Python": lambda: slot_us(by_command(place, "run", *in_ring, "--planner", planner)),
        }
        times: dict[str, list[float]] = {name: [] for name in flights}
        for _ in range(repetitions):
            for name, fly in flights.items():
                times[name].append(fly())
    print(f"{'letter.toml, 20 000 slots':<28} {'µs a slot':>10} {'lowest':>10} {'highest':>10}")
    for name, all_us in times.items():
        print(f"{name:<28} {median(all_us):>10.2f} {min(all_us):>10.2f} {max(all_us):>10.2f}")
    return 0


def slot_us(summary: dict[str, Any]) -> float:
    """The median time of a slot of the ring [µs]."""
    time: float = summary["timing"]["latency"]["slot"]["p50_us"]
    return time


if __name__ == "__main__":
    sys.exit(main())
