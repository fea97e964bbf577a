"""`examples/cluster`: the same bytes as `skysink sweep`; for shards, although a process is killed during the sweep."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT, run, same_files

CLUSTER = ROOT / "examples" / "cluster"

FILES = ["results.csv", "summary.csv"]

SHARDS = 5

SWEEP_FILE = "my sweep.toml"

OUT = "my results"

SWEEP = f"""
scenario = "{ROOT}/scenarios/letter.toml"
strategies = ["uts", "gfs"]
seeds = 400
"""

KILLED_ONCE = """#!/bin/sh
# skysink, killed once it has flown a mission of the shard in the folder 3, the first time.
for word; do
    case $word in */3) folder=$word ;; esac
done
if [ "$1" = sweep ] && [ -n "$folder" ] && mkdir 'FLAG' 2> /dev/null; then
    'SKYSINK' "$@" &
    while [ ! -s "$folder/journal.csv" ]; do sleep 0.01; done
    kill -9 $!
    exit 137
fi
exec 'SKYSINK' "$@"
"""


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a sweep, and its results `alone`."""
    (tmp_path / SWEEP_FILE).write_text(SWEEP)
    run("sweep", SWEEP_FILE, "--out", "alone", cwd=tmp_path)
    return tmp_path


def environment(place: Path) -> dict[str, str]:
    """Variables with which `skysink` is killed once."""
    programs = place / "bin"
    programs.mkdir(exist_ok=True)
    text = KILLED_ONCE.replace("FLAG", str(place / "flag"))
    (programs / "skysink").write_text(text.replace("SKYSINK", str(Path(sys.executable).with_name("skysink"))))
    (programs / "skysink").chmod(0o755)
    return {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}


def need(*programs: str) -> None:
    """Skips the test if programs are missing."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not installed")


def command(*words: str | Path, place: Path) -> str:
    """Runs a command in which `skysink` is killed once, and returns what it printed."""
    result = subprocess.run(words, cwd=place, capture_output=True, text=True, timeout=300, env=environment(place))
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_parallel_repeats_a_shard_whose_process_was_killed(place: Path) -> None:
    need("parallel")
    command(CLUSTER / "parallel.sh", SWEEP_FILE, OUT, str(SHARDS), place=place)
    assert (place / "flag").exists()
    same_files(place / "alone", place / OUT, FILES)


def test_snakemake_repeats_a_shard_whose_process_was_killed(place: Path) -> None:
    need("snakemake")
    values = [f"sweep={SWEEP_FILE}", f"out={OUT}", f"shards={SHARDS}"]
    command("snakemake", "--snakefile", CLUSTER / "Snakefile", "--cores", "2", "--config", *values, place=place)
    assert (place / "flag").exists()
    same_files(place / "alone", place / OUT, FILES)


def test_slurm_runs_the_shards_that_the_merge_reports_missing(place: Path) -> None:
    need("sbatch", "sinfo")
    if subprocess.run(["sinfo"], capture_output=True).returncode != 0:
        pytest.skip("no Slurm controller answers")

    def submit(*array: str) -> str:
        """Submits the array and its merge, waits for both, and returns what the merge printed."""
        printed = command(CLUSTER / "slurm.sh", SWEEP_FILE, OUT, str(SHARDS), *array, place=place)
        job = re.findall(r"\d+", printed)[-1]
        deadline = time.monotonic() + 300
        while job in subprocess.run(["squeue", "-h", "-o", "%A"], capture_output=True, text=True).stdout.split():
            assert time.monotonic() < deadline, "the jobs did not end"
            time.sleep(0.5)
        return (place / f"slurm-{job}.out").read_text()

    said = submit()
    assert (place / "flag").exists() and not (place / OUT).exists()
    assert "run shards 3 of 5, for example by --array=3 and --shard $SLURM_ARRAY_TASK_ID/5" in said
    assert f"800 missions: {OUT}/results.csv" in submit("3")
    same_files(place / "alone", place / OUT, FILES)


def test_the_program_for_dask_has_the_bytes_of_the_command_line(place: Path) -> None:
    pytest.importorskip("distributed")
    printed = command(sys.executable, CLUSTER / "dask_sweep.py", SWEEP_FILE, OUT, place=place)
    assert printed == f"800 missions: {OUT}/results.csv\n"
    same_files(place / "alone", place / OUT, FILES)


def test_the_program_for_ray_has_the_bytes_of_the_command_line(place: Path) -> None:
    pytest.importorskip("ray")
    printed = command(sys.executable, CLUSTER / "ray_sweep.py", SWEEP_FILE, OUT, place=place)
    assert f"800 missions: {OUT}/results.csv\n" in printed
    same_files(place / "alone", place / OUT, FILES)
