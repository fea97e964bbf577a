"""The policies of deep reinforcement learning in `python/examples`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import skysink
from skysink import library

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.mark.parametrize("policy", ["dqn", "ppo"])
def test_a_policy_is_verified_on_the_library(policy: str, tmp_path: Path) -> None:
    """It loses less than `gfs`, and its run is that of the same class from a file."""
    words: list[str | Path] = [sys.executable, EXAMPLES / "library_fly.py", "sks-500-200", "--policy", policy, "--out", tmp_path]
    header, row = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    assert header == "instance,strategy,value"
    placement = library.verify(tmp_path / f"sks-500-200-{policy}" / "1")
    assert row == f"sks-500-200,{policy},{placement['value']}"
    scenario = library.copy("sks-500-200", tmp_path)
    assert placement["value"] < 0.5 * skysink.simulate(scenario, "gfs").loss_rate
    again = skysink.simulate(scenario, f"python:{EXAMPLES / 'library_fly.py'}:{policy.upper()}")
    assert again.loss_rate == placement["value"]


def test_the_policy_of_the_small_fields_loses_what_the_book_says() -> None:
    """Over the seeds 1 to 20 (`docs/src/training.md`)."""
    compared = skysink.compare(EXAMPLES / "small.toml", [f"python:{EXAMPLES / 'ppo_fly.py'}:PPO"], seeds=20)
    assert [round(row["mean"], 3) for row in compared if row["metric"] == "loss_rate"] == [0.066]


@pytest.mark.parametrize("algorithm", ["dqn", "ppo"])
def test_the_training_script_trains(algorithm: str, tmp_path: Path) -> None:
    """A round of it, where the packages of `requirements-rl.txt` are installed."""
    pytest.importorskip("skrl")
    words: list[str | Path] = ["--task", "library", "--algorithm", algorithm, "--steps", "1", "--out", tmp_path]
    subprocess.run([sys.executable, EXAMPLES / "rl_train.py", *words], check=True)
    assert {path.suffix for path in tmp_path.glob(f"{algorithm}_library_*")} == {".npz", ".csv", ".png"}
