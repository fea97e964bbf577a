"""Trains the policy of ppo_fly.py by PPO, with skrl, or DQN (JAX), over a new field in every episode.

    pip install ./python -r python/examples/requirements-rl.txt
    python python/examples/rl_train.py                     # writes ppo_weights.npz, ppo_curve.csv and ppo_curve.png
    python python/examples/rl_train.py --task fleet        # the same as ppo_fleet_*, for the two UAVs of small_fleet.toml
    python python/examples/rl_train.py --task library --steps 143360                      # ppo_library_*, for library_fly.py
    python python/examples/rl_train.py --task library --steps 163840 --algorithm dqn      # dqn_library_*

The UAVs of a fleet share one policy: each is an environment of its own to the training, and earns the bits that are
delivered because of it. For the library the fields are those of typical.toml, of four sides and sampling rates.

After every 320 slots the deterministic policy is evaluated on the twenty fields of the seeds 1001 to 1020, and the weights
with the lowest loss rate so far are saved: those of DQN after 40,960 steps. ppo_fly.py, ppo_fleet.py and library_fly.py
fly them on other fields.
"""

from __future__ import annotations

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import argparse
import csv
import time
from pathlib import Path
from typing import NamedTuple

import gymnasium
import matplotlib
import numpy as np
import rl_dqn
import rl_ppo
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from ppo_fly import Weights, choose
from rl_envs import HERE, JUDGED, JUDGED_FROM, TASKS, Agents, Shaped, Targets
from skrl.utils import set_seed

SLOTS = 320  # between two evaluations
TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]  # of the figure's loss rates


class Row(NamedTuple):
    """A line of the learning curve."""

    steps: int
    seconds: float
    training_loss_rate: float  # of the last episodes, stochastic
    loss_rate: float  # of the evaluation, deterministic


def judge(envs: Targets, weights: Weights, slots: int) -> float:
    """The mean loss rate of one mission in each environment."""
    observation, _ = envs.reset(seed=JUDGED_FROM)
    lost = 0.0
    for _ in range(slots):
        observation, rewards, *_ = envs.step(choose(weights, observation))
        lost -= float(rewards.mean())  # every slot samples the same number of bits
    return float(np.mean(envs.env.loss_rates)) if isinstance(envs.env, Agents) else lost / slots


def write_curve(rows: list[Row], name: str, folder: Path) -> None:
    with (folder / f"{name}_curve.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        writer.writerows((row.steps, f"{row.seconds:.1f}", *(f"{rate:.5f}" for rate in row[2:])) for row in rows)
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 3.5), layout="constrained")
    million = [row.steps / 1e6 for row in rows]
    axes.plot(million, [row.training_loss_rate for row in rows], color="0.6", label="training, stochastic")
    axes.plot(million, [row.loss_rate for row in rows], color="C0", label=f"{JUDGED} other fields, deterministic")
    axes.set(xlabel="environment steps [million]", ylabel="loss rate η", yscale="log")
    least = min(row.loss_rate for row in rows)
    ticks = [tick for tick in TICKS if tick >= 0.5 * least]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(min(ticks[0], least), 1.0)
    axes.legend(frameon=False)
    figure.savefig(folder / f"{name}_curve.png", dpi=150)
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description="Trains a policy by deep reinforcement learning.")
    parser.add_argument("--algorithm", choices=["ppo", "dqn"], default="ppo", help="[ppo]")
    parser.add_argument("--task", choices=list(TASKS), default="small", help="what to train for [small]")
    parser.add_argument("--steps", type=float, default=2.5e6, help="steps of all environments [2.5e6]")
    parser.add_argument("--seed", type=int, default=1_000_001, help="of weights, choices and the first field [1000001]")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write [that of this file]")
    args = parser.parse_args()
    task = TASKS[args.task]
    name = args.algorithm if args.task == "small" else f"{args.algorithm}_{args.task}"
    set_seed(args.seed)
    rounds = max(1, round(args.steps / (task.envs * SLOTS)))
    fresh = task.make(task.envs)
    judge_envs = task.make(JUDGED, JUDGED_FROM, JUDGED)
    recorded = RecordEpisodeStatistics(fresh, buffer_length=task.envs)
    envs: gymnasium.vector.VectorEnv = Shaped(recorded) if task.is_shaped else recorded
    learner = rl_ppo.Learner(envs, SLOTS, rounds) if args.algorithm == "ppo" else rl_dqn.Learner(envs, SLOTS, rounds, args.seed)

    args.out.mkdir(parents=True, exist_ok=True)
    slots = task.scenarios()[0].slots
    rows: list[Row] = []
    begin = time.perf_counter()
    for number in range(1, rounds + 1):
        weights = learner.train()
        of_returns = -float(np.mean(recorded.return_queue)) / slots
        training_loss_rate = float(np.mean(fresh.env.loss_rates)) if isinstance(fresh.env, Agents) else of_returns
        loss_rate = judge(judge_envs, weights, slots)
        if loss_rate < min((row.loss_rate for row in rows), default=1.0):
            np.savez(args.out / f"{name}_weights.npz", allow_pickle=False, **weights)
        rows.append(Row(number * task.envs * SLOTS, time.perf_counter() - begin, training_loss_rate, loss_rate))
        print("{:9,} steps, {:4.0f} s: loss rate {:.4f} stochastic, {:.4f} deterministic".format(*rows[-1]), flush=True)
        write_curve(rows, name, args.out)


if __name__ == "__main__":
    main()
