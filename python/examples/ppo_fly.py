"""Compares the policy of ppo_train.py with Skysink's strategies, on twenty fields that were not used in training.

    python python/examples/ppo_fly.py

It only needs skysink and NumPy. In every slot the policy chooses the sensor node (SN) to fly towards. A small network
with shared weights scores each SN from its direction, distance, position and queue, and from a mean over all SNs; the highest
score wins. So the policy is invariant to the order of the SNs and works for any number of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import skysink
from numpy.typing import NDArray

SCENARIO = Path(__file__).with_name("small.toml")
WEIGHTS = Path(__file__).with_name("ppo_weights.npz")
REACH = 0.2  # of one slot, in sides of the area: uav.max_speed_mps * slot_s / area.side_m
RANGE = 0.1  # of a link, likewise: link.comm_radius_m / area.side_m
LAYERS = 4

Array = Any  # of NumPy, or of JAX while it trains
Weights = dict[str, NDArray[np.float32]]


def features(seen: dict[str, Array], xp: Any = np) -> Array:
    """The features of each SN [..., N, 7], or [..., N, 8 + U] of a fleet: the nearest other UAV, and who the agent is.

    Positions [..., N, 2], queues [..., N], UAV [..., 3], others [..., U - 1, 2] and agent [..., U] are those of an observation;
    `xp` is the array module.
    """

    def away(offset: Array) -> list[Array]:
        distance = xp.sqrt((offset**2).sum(-1, keepdims=True) + 1e-6)  # with a slope at 0, for the training
        return [distance / (2.0 * REACH), xp.exp(-((distance / RANGE) ** 2))]

    positions, queues = seen["positions"], seen["queues"]
    offset = positions - seen["uav"][..., None, :2]
    nearby = [offset / (2.0 * REACH), *away(offset)]
    if "others" in seen:
        of_others = offset[..., None, :] - seen["others"][..., None, :, :]
        distance, near = away(of_others)
        own = xp.broadcast_to(seen["agent"][..., None, 1:], (*queues.shape, seen["agent"].shape[-1] - 1))
        nearby += [xp.min(distance, -2), xp.max(near, -2), own]  # without who they are, two UAVs in one place stay together
    return xp.concatenate([*nearby, 2.0 * queues[..., None] - 1.0, 2.0 * positions - 1.0], -1)


def choose(weights: Weights, observation: dict[str, NDArray[Any]]) -> NDArray[np.intp]:
    """The SN to fly towards, with the highest score, for one observation or a batch."""

    def dense(layer: int, value: NDArray[Any]) -> NDArray[Any]:
        return value @ weights[f"kernel_{layer}"] + weights[f"bias_{layer}"]

    each = np.tanh(dense(0, features(observation)))
    mean = np.tanh(dense(1, each)).mean(-2, keepdims=True)
    both = np.tanh(dense(2, np.concatenate([each, np.broadcast_to(mean, each.shape)], -1)))
    return np.asarray(dense(3, both)[..., 0].argmax(-1))


def load(path: Path = WEIGHTS) -> Weights:
    """Reads the weights written by ppo_train.py."""
    with np.load(path, allow_pickle=False) as weights:
        return dict(weights)


class PPO(skysink.Strategy):
    """The trained policy, deterministic; it serves the fullest queues in range."""

    def __init__(self) -> None:
        self.weights = load()

    def begin(self, field: skysink.Field) -> None:
        self.positions_m = field.positions_m
        self.area_m = np.array(field.area_m)

    def plan(self, view: skysink.View) -> skysink.Decision:
        observation = {
            "positions": self.positions_m / self.area_m,
            "queues": view.queues_bits / view.field.capacity_bits,
            "uav": np.array([*(view.uav[:2] / self.area_m), 0.0]),
        }
        target = choose(self.weights, observation)
        return skysink.Decision(view.field.toward(view.uav, self.positions_m[target]))


def main() -> None:
    standings = skysink.compare(SCENARIO, ["rfs", "gfs", "uts", "exact", PPO, "tour", "horizon"], seeds=20)
    print("strategy  loss rate  95 % interval")
    for row in standings:
        if row["metric"] == "loss_rate":
            lowest, highest = row["ci95"]
            print(f"{row['label']:<8} {row['mean']:10.4f}  {lowest:.4f} to {highest:.4f}")


if __name__ == "__main__":
    main()
