"""Strategies in Python as the planner of a running ring."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import GFS, ROOT, run, same_files

import skysink

LONG = """
name = "long"
slots = 1500
slot_s = 0.1
[uav]
endurance_s = 1e6
"""

MINE = GFS + """
import skysink.ring
skysink.ring.planner(GFS)
"""

COUNTING = """
import skysink, skysink.ring

class Counting(skysink.Strategy):
    '''Flies to one SN after the other: its state is whose turn it is.'''

    def begin(self, field):
        self.turn = 0

    def plan(self, view):
        goal = view.field.positions_m[self.turn % len(view.field)]
        waypoint = view.field.toward(view.uav, goal)
        self.turn += bool((waypoint == goal).all())
        return skysink.Decision(waypoint)

    def save(self):
        return str(self.turn).encode()

    def restore(self, state):
        self.turn = int(state)

if __name__ == "__main__":
    skysink.ring.planner(Counting)
"""

LEARNING = """
import skysink

class Learning(skysink.Strategy):
    '''Flies to the queue that will be longest, and refuses to know more than the mean of the rates before slot 1.'''

    def begin(self, field):
        assert set(field.sampling_bps) == {175.0}

    def plan(self, view):
        reachable = view.field.within(view.uav, view.field.reach_m)
        if not len(reachable):
            return None
        soon = view.queues_bits + 20 * view.sampling_bps
        return skysink.Decision(view.field.positions_m[reachable[soon[reachable].argmax()]])

if __name__ == "__main__":
    import skysink.ring
    skysink.ring.planner(Learning())
"""

TIMEOUT_S = 240.0


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder for rings, which must leave nothing in shared memory."""
    rings = Path(tempfile.mkdtemp(dir="/tmp"))  # a short path, as those of sockets have to be
    monkeypatch.setenv("TMPDIR", str(rings))
    (tmp_path / "long.toml").write_text(LONG)
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "counting.py").write_text(COUNTING)
    (tmp_path / "learning.py").write_text(LEARNING)
    yield tmp_path
    left = [ring for home in rings.glob("skysink-*") for ring in home.iterdir() if ring.is_dir()]
    shutil.rmtree(rings)
    assert not left


def begin(place: Path, *arguments: str) -> subprocess.Popen[str]:
    """Starts the command line."""
    words = [str(Path(sys.executable).with_name("skysink")), *arguments]
    return subprocess.Popen(words, cwd=place, stderr=(place / "said").open("w"), text=True)


def end(process: subprocess.Popen[str]) -> int:
    """Waits for the process to end, and returns its exit code."""
    return process.wait(TIMEOUT_S)


def until(what: str, process: subprocess.Popen[str], is_so: object) -> None:
    """Waits until `is_so()`; fails if the process ends or after a timeout."""
    limit = time.monotonic() + TIMEOUT_S
    while not is_so():  # type: ignore[operator]
        assert process.poll() is None and time.monotonic() < limit, f"no {what}"
        time.sleep(0.01)


def slots(place: Path) -> int:
    """Slots on record."""
    trace = place / "run" / "slots.csv"
    return trace.read_text().count("\n") - 1 if trace.exists() else 0


def by_hand(place: Path) -> dict[str, str]:
    """The environment of a program that is started by hand, as the run has printed it."""
    said = (place / "said").read_text()
    ring, scenario = (re.search(rf"--{name} (\S+)", said) for name in ("ring", "scenario"))
    assert ring is not None and scenario is not None
    return {**os.environ, "SKYSINK_RING": ring[1], "SKYSINK_SCENARIO": scenario[1]}


def children(process: subprocess.Popen[str], word: str) -> list[int]:
    """The children of a process whose command has this word."""
    found = []
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            command = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            found += [int(child)] if word.encode() in command else []
    return found


@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
def test_a_python_strategy_has_the_bytes_of_its_rust_counterpart(place: Path, knowledge: str) -> None:
    chosen = ["--set", f"planner.knowledge={knowledge}", "--strategy", "gfs"]
    scenario = str(ROOT / "scenarios" / "smoke.toml")
    run("simulate", scenario, *chosen, "--out", "alone", cwd=place)
    planner = ["--planner", f"{sys.executable} mine.py"]
    run("run", scenario, *chosen, "--no-viewer", "--out", "run", *planner, "--label", "mine", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv", "sensors.csv", "scenario.toml"])
    assert json.loads((place / "run" / "summary.json").read_text())["strategy"] == "mine"


def test_learnt_rates_equal_those_of_a_single_process(place: Path) -> None:
    learnt = {"planner.knowledge": "estimated", "planner.rates": "learnt", "sensors.sampling_bps": [50.0, 300.0]}
    smoke = skysink.Scenario.load(ROOT / "scenarios" / "smoke.toml").replace(learnt)
    (place / "learnt.toml").write_text(smoke.to_toml())
    alone = skysink.simulate(smoke, f"python:{place / 'learning.py'}:Learning")
    alone.save(place / "alone")
    planner = ["--planner", f"{sys.executable} learning.py"]
    run("run", "learnt.toml", "--no-viewer", "--out", "run", *planner, cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv", "sensors.csv"])


@pytest.mark.parametrize(
    ("file", "killed"), [("mine.py", "mine.py"), ("counting.py", "counting.py"), ("mine.py", "flight-sim")]
)
def test_a_killed_and_restarted_planner_flies_the_same(place: Path, file: str, killed: str) -> None:
    planner = ["run", "long.toml", "--no-viewer", "--planner", f"{sys.executable} {file}"]
    run(*planner, "--out", "whole", cwd=place)
    process = begin(place, *planner, "--out", "run")
    for kill in range(1, 4):
        until("flight", process, lambda kill=kill: slots(place) > 300 * kill)
        for planner_id in children(process, killed):
            os.kill(planner_id, signal.SIGKILL)
    assert end(process) == 0, (place / "said").read_text()
    same_files(place / "whole", place / "run", ["slots.csv"])
    assert json.loads((place / "run" / "summary.json").read_text())["restarts"] >= 1


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_manually_started_planner_ends_on_a_signal(place: Path, sent: signal.Signals, code: int) -> None:
    process = begin(place, "run", "long.toml", "--no-viewer", "--external", "planner", "--out", "run")
    said = place / "said"
    until("ring", process, lambda: re.search(r"--ring (/\S+)", said.read_text()))
    for slot, expected in ((100, code), (10**9, 0)):
        planner = subprocess.Popen([sys.executable, "mine.py"], cwd=place, env=by_hand(place))
        if slot < 1500:
            until("flight", process, lambda slot=slot: slots(place) > slot)
            planner.send_signal(sent)
        assert planner.wait(TIMEOUT_S) == expected
    assert end(process) == 0, said.read_text()
    run("simulate", "long.toml", "--strategy", "gfs", "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])


def test_a_planner_in_a_paced_ring_uses_the_newest_queues(place: Path) -> None:
    stall = "def plan(self, view):\n        __import__('time').sleep((view.slot == 9) * 0.8)"
    slow = MINE.replace("def plan(self, view):", stall)
    (place / "slow.py").write_text(slow)
    paced = ["--pace", "realtime", "--set", "slots=40", "--planner", f"{sys.executable} slow.py"]
    run("run", "long.toml", "--no-viewer", *paced, "--out", "run", cwd=place)
    held = [line for line in (place / "run" / "slots.csv").read_text().splitlines() if ",hold," in line]
    timing = json.loads((place / "run" / "summary.json").read_text())["timing"]
    assert timing["missed_deadlines"] == len(held) >= 7, "0.8 s of slots of 0.1 s"
    assert int(held[-1].partition(",")[0]) < 35, "it does not plan for slots that have begun"
    assert timing["plan_p50_us"] > 1.0


def test_a_hanging_planner_in_a_paced_ring_is_reported_and_restarted(place: Path) -> None:
    hang = """def plan(self, view):
        import pathlib, time
        if view.slot >= 20 and not pathlib.Path("hung").exists():
            pathlib.Path("hung").touch()
            time.sleep(1000)"""
    (place / "hangs.py").write_text(MINE.replace("def plan(self, view):", hang))
    paced = ["--pace", "realtime", "--set", "slots=100", "--timeout", "3"]
    planner = ["--planner", f"{sys.executable} hangs.py"]
    run("run", "long.toml", "--no-viewer", *paced, *planner, "--out", "run", cwd=place)
    summary = json.loads((place / "run" / "summary.json").read_text())
    events = [event["event"] for event in summary["events"] if event["process"] == "planner"]
    late = ["has sent no sample for 1.", "has sent no plan in time for"]
    for event in [*late, "was killed", "was restarted", "recovered"]:
        assert any(found.startswith(event) for found in events), (event, events)
    trace = (place / "run" / "slots.csv").read_text().splitlines()
    assert all(",hold," not in line for line in trace[-5:]), "it plans again"


def test_a_suspended_planner_continues(place: Path) -> None:
    paced = ["--pace", "realtime", "--set", "slots=50", "--planner", f"{sys.executable} mine.py"]
    process = begin(place, "run", "long.toml", "--no-viewer", *paced, "--out", "run")
    until("flight", process, lambda: slots(place) > 20)
    for sent in (signal.SIGSTOP, signal.SIGCONT):
        for planner in children(process, "mine.py"):
            os.kill(planner, sent)
        time.sleep(0.3)
    assert end(process) == 0, (place / "said").read_text()
    assert json.loads((place / "run" / "summary.json").read_text())["restarts"] == 0


def test_a_planner_ends_with_its_launcher(place: Path) -> None:
    long = ["run", "long.toml", "--set", "slots=100000", "--no-viewer"]
    process = begin(place, *long, "--external", "planner", "--out", "run")
    said = place / "said"
    until("ring", process, lambda: re.search(r"--ring (/\S+)", said.read_text()))
    planner = subprocess.Popen([sys.executable, "mine.py"], cwd=place, env=by_hand(place))
    until("flight", process, lambda: slots(place) > 50)
    second = subprocess.run(
        [sys.executable, "mine.py"], cwd=place, capture_output=True, text=True, timeout=60, env=by_hand(place)
    )  # fmt: skip
    assert second.returncode != 0 and "there is a planner already: end it first" in second.stderr
    process.kill()
    process.wait(TIMEOUT_S)
    assert planner.wait(TIMEOUT_S) != 0
    # The next launcher clears what is left.
    run("run", str(ROOT / "scenarios" / "smoke.toml"), "--no-viewer", "--out", "next", cwd=place)


def test_an_exception_of_a_strategy_ends_the_run_and_is_printed(place: Path) -> None:
    failing = MINE.replace("def plan(self, view):", "def plan(self, view):\n        1 / (view.slot < 9)")
    (place / "fails.py").write_text(failing)
    arguments = [str(ROOT / "scenarios" / "smoke.toml"), "--no-viewer", "--planner", f"{sys.executable} fails.py"]
    failed = run("run", *arguments, "--out", "run", cwd=place, code=1)
    assert "ZeroDivisionError" in failed.stderr
    assert "planner ended with exit code 1" in failed.stderr


def test_a_folder_without_ring_is_refused(place: Path) -> None:
    no_ring = {**os.environ, "SKYSINK_RING": str(place), "SKYSINK_SCENARIO": str(ROOT / "scenarios" / "smoke.toml")}
    words = [sys.executable, "mine.py"]
    result = subprocess.run(words, cwd=place, capture_output=True, text=True, timeout=60, env=no_ring)
    assert result.returncode != 0
    assert "InputError: ring" in result.stderr
    result = subprocess.run(words, cwd=place, capture_output=True, text=True, timeout=60)
    assert "expected the folder of a running ring, or SKYSINK_RING from skysink run --planner" in result.stderr


def test_a_resumed_run_with_estimated_queues_flies_the_same(place: Path) -> None:
    estimated = ["--set", "planner.knowledge=estimated"]
    planner = ["--no-viewer", "--planner", f"{sys.executable} mine.py"]
    process = begin(place, "run", "long.toml", *estimated, *planner, "--out", "run")
    until("flight", process, lambda: slots(place) > 300)
    process.send_signal(signal.SIGINT)
    assert end(process) == 130, (place / "said").read_text()
    run("run", "--resume", "run", *planner, cwd=place)
    run("simulate", "long.toml", *estimated, "--strategy", "gfs", "--out", "alone", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])
