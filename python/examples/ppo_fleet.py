"""Compares the shared policy of rl_train.py --task fleet with Skysink's strategies, on twenty fields that were not used in training.

    python python/examples/ppo_fleet.py

It only needs skysink and NumPy. In every slot each UAV chooses the sensor node to fly towards, by the network of ppo_fly.py
with its own position, those of the others and its number.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import skysink
from numpy.typing import NDArray
from ppo_fly import Weights, choose, load, scale_of

SCENARIO = Path(__file__).with_name("small_fleet.toml")
WEIGHTS = Path(__file__).with_name("ppo_fleet_weights.npz")
FIELDS = 20
OBSERVED = {"uav": (3,), "queues": (-1,), "positions": (-1, 2), "others": (-1, 2), "agent": (-1,)}  # and their shapes


def loss_rates(scenario: skysink.Scenario, weights: Weights) -> NDArray[np.float64]:
    """The loss rate of the policy over each of the fields from the scenario's seed on [FIELDS]."""
    batch = skysink.FleetBatch(FIELDS, scenario, FIELDS, list(OBSERVED))
    actions, observations, rewards, down, over = batch.arrays()
    batch.reset_into(observations)
    scale = scale_of(scenario.field()).astype(np.float32)
    while not over.any():
        seen = {name: observations[..., place].reshape(FIELDS, batch.agents, *OBSERVED[name]) for name, place in batch.slices.items()}
        targets = choose(weights, seen | {"scale": scale})
        towards = np.take_along_axis(seen["positions"], targets[..., None, None], axis=-2)[..., 0, :]
        actions[...] = (towards - seen["uav"][..., :2]) / scale[0]  # the environment shortens what is longer than a flight
        batch.step_into(actions, observations, rewards, down, over)
    sampled_bits: float = scenario.slots * scenario.to_dict()["slot_s"] * float(np.sum(scenario.sensors()["sampling_bps"]))
    lost_bits, _delivered_bits = batch.totals
    return lost_bits / sampled_bits


def main() -> None:
    scenario = skysink.Scenario.load(SCENARIO)
    print("strategy     coordination  loss rate")
    for coordination in ("independent", "sequential", "partition"):
        together = scenario.replace({"uav.coordination": coordination})
        for row in skysink.compare(together, ["rfs", "uts", "tour", "horizon"], seeds=FIELDS):
            if row["metric"] == "loss_rate":
                print(f"{row['label']:<12} {coordination:<12} {row['mean']:10.4f}")
    rates = loss_rates(scenario, load(WEIGHTS))
    print(f"{'shared PPO':<25} {rates.mean():10.4f}")


if __name__ == "__main__":
    main()
