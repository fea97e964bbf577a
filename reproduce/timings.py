"""The timings of the book: tables that differ from run to run, computed with the executables in PATH."""

import json
import os
import platform
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from shutil import rmtree, which

from entries import OUT, SIDE, entry, run, table, version


def machine():
    """The processor, and the number of cores."""
    names = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def bench(part):
    """The table of a part of `skysink-bench`, with version, machine and command below."""
    _, measured = run("skysink-bench", "--only", part).split("┘", 1)
    return f"```\n{measured.strip()}\n```\n\n*{version()}, {machine()}: `reproduce/run bench-{part}`*"


@entry("bench-planner", 1, is_timing=True)
def bench_planner():
    """The time of a plan."""
    return bench("planner")


@entry("bench-field", 0.1, is_timing=True)
def bench_field():
    """The time of a slot of the field."""
    return bench("field")


@entry("bench-mission", 0.5, is_timing=True)
def bench_mission():
    """The slots per second of missions in one process."""
    return bench("mission")


@entry("bench-ring", 5, is_timing=True)
def bench_ring():
    """The time of a round trip of the ring."""
    return bench("ring")


@entry("bench-fleet", 2, is_timing=True)
def bench_fleet():
    """The time of the plans and the ring of several UAVs."""
    return bench("fleet")


def timed_table(name, head, rows):
    """A table of timings, with the processor below."""
    return table(name, head, rows, machine())


def words_of(keys):
    """The arguments that override these keys."""
    return [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]


@entry("sweeps", 0.4, is_timing=True)
def sweeps():
    """Missions per second and memory of sweeps."""
    rows = []
    for count, side_m, seeds in [(200, 100.0, 1000), (10_000, 707.0, 400), (1_000_000, 7071.0, 6)]:
        text = f'scenario = "{Path("scenarios/letter.toml").resolve()}"\nstrategies = ["uts"]\nseeds = {seeds}\n'
        text += f'[axes]\n"slots" = [600]\n"sensors.count" = [{count}]\n"{SIDE}" = [{side_m}]\n'
        file = OUT / "sweep.toml"
        file.write_text(text)
        speeds, memory_mb = [], []
        for threads in [1, 2]:
            out = OUT / f"sweeps-{count}-{threads}"
            rmtree(out, ignore_errors=True)
            command = ["skysink", "sweep", file, "--out", out, "--threads", str(threads)]
            begin = time.monotonic()
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            if status:
                raise subprocess.CalledProcessError(status, command)
            speeds.append(seeds / (time.monotonic() - begin))
            memory_mb.append(usage.ru_maxrss / 1e3)
        cells = [f"{speeds[0]:.3g}", f"{speeds[1] / speeds[0]:.2f}", *(f"{size:.0f}" for size in memory_mb)]
        rows.append([count, f"{side_m:.0f} m", *cells])
    head = ["N", "side", "missions/s, one thread", "two threads: times as fast", "memory, one [MB]", "two [MB]"]
    return timed_table("sweeps", head, rows)


def ring_run(slots, *words, before=()):
    """The timing of a run in the ring of the paper's mission with so many slots."""
    folder = OUT / "ring"
    keys = words_of({"slots": slots, "uav.endurance_s": slots})
    run(*before, "skysink", "run", "scenarios/letter.toml", "--out", folder, "--force", *words, *keys)
    return json.loads((folder / "summary.json").read_text())["timing"]


WAITS = ["adaptive", "event"]


@entry("few-cores", 5.5, is_timing=True)
def few_cores():
    """Slots per second of the ring with few cores, and its missed deadlines."""
    rows = []
    for label, cores, busy, words in [
        ("two cores", "0,1", 0, ["--no-viewer"]),
        ("one core", "1", 0, ["--no-viewer"]),
        ("two cores, one of them busy", "0,1", 1, ["--no-viewer"]),
        ("two cores, both busy", "0,1", 2, ["--no-viewer"]),
        ("two cores, with a viewer", "0,1", 0, []),
    ]:
        on_cores = ["taskset", "-c", cores]
        programs = [subprocess.Popen([*on_cores, sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
        try:
            turns = [
                [ring_run(20_000, "--wait", wait, *words, before=on_cores)["slots_per_s"] for wait in WAITS]
                for _ in range(3)
            ]
        finally:
            for program in programs:
                program.kill()
                program.wait()
        adaptive, event = (sorted(speeds)[1] for speeds in zip(*turns))
        rows.append([label, f"{adaptive:.0f}", f"{event:.0f}", f"{adaptive / event:.2f}"])
    paced = [
        ring_run(30_000, "--no-viewer", "--pace", "1000x", "--wait", wait, before=["taskset", "-c", "0,1"])
        for wait in WAITS
    ]
    missed = [timing["missed_deadlines"] for timing in paced]
    rows.append(["missed plans of 30 000, slots of 1 ms", *missed, ""])
    return timed_table("few-cores", ["", *WAITS, "adaptive ÷ event"], rows)


@entry("recordings", 0.3, is_timing=True)
def recordings():
    """Bytes and time per slot of recordings."""

    def recorded(command, *words):
        sizes, times_s = [], []
        for slots in [2000, 6000]:
            folder = OUT / "recorded"
            keys = words_of({"slots": slots, "uav.endurance_s": slots})
            begin = time.monotonic()
            run("skysink", command, "scenarios/letter.toml", "--out", folder, "--force", *words, *keys)
            times_s.append(time.monotonic() - begin)
            sizes.append((folder / "mission.rrd").stat().st_size)
        each, each_s = (sizes[1] - sizes[0]) / 4000, (times_s[1] - times_s[0]) / 4000
        return [f"{each:.0f}", f"{(sizes[0] - 2000 * each) / 1e3:.0f}", f"{each_s * 1e3:.2f}"]

    rows = [
        ["`simulate --record`", *recorded("simulate", "--record")],
        ["`run`, with the curves of plan time and pace", *recorded("run")],
        ["`run --record-every 10`", *recorded("run", "--record-every", 10)],
    ]
    head = ["N = 200", "bytes per slot", "constant part [kB]", "time per slot [ms]"]
    return timed_table("recordings", head, rows)


@entry("numpy", 0.7, is_timing=True, needs="numpy")
def numpy():
    """The time of a plan against NumPy, Clarabel and CVXPY."""
    text = run(sys.executable, "python/benchmarks/compare.py", "--skysink", which("skysink"))
    rows = defaultdict(list)
    for line in text.splitlines():
        name, cells = line[:24].strip(), line[24:].split()[:4]
        if len(cells) == 4 and all(cell.replace(".", "").isdigit() for cell in cells):
            rows[name] += cells
    head = ["plan [µs]"]
    for scenario in ["letter", "link-limited"]:
        head += [f"{scenario}: p50", "p99", "p50 ÷ Skysink's", "p99 ÷"]
    return timed_table("numpy", head, [[name, *cells] for name, cells in rows.items()])
