"""The policy of rl_train.py as a strategy; compares it, trained by PPO for small.toml, with Skysink's strategies.

    python python/examples/ppo_fly.py

It only needs skysink and NumPy. In every slot the policy chooses the sensor node (SN) to fly towards. A small network
with shared weights scores each SN from its direction, distance, position and queue, and from a mean over all SNs; the highest
score wins. So the policy is invariant to the order of the SNs and works for any number of them. The twenty fields were not
used in training.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import skysink
from numpy.typing import NDArray

SCENARIO = Path(__file__).with_name("small.toml")
WEIGHTS = Path(__file__).with_name("ppo_weights.npz")
LAYERS = 4

Array = Any  # of NumPy, or of JAX while it trains
Weights = dict[str, NDArray[np.float32]]


def features(seen: dict[str, Array], xp: Any = np) -> Array:
    """The features of each SN [..., N, 7], one more with `fills`, and in a fleet 1 + U more: the nearest other UAV, and who
    the agent is.

    Positions [..., N, 2], queues [..., N], UAV [..., 3], others [..., U - 1, 2] and agent [..., U] are those of an observation;
    `scale` [..., 2] is that of `scale_of`, and `fills` [..., N] the fraction of its buffer that an SN samples in a slot. `xp`
    is the array module.
    """

    def reach_and_range(axes: int) -> tuple[Array, Array]:
        """Both with as many axes as an array that they scale."""
        shape = (*seen["scale"].shape[:-1], *[1] * (axes + 1 - seen["scale"].ndim))
        return seen["scale"][..., 0].reshape(shape), seen["scale"][..., 1].reshape(shape)

    def away(offset: Array) -> list[Array]:
        reach, radius = reach_and_range(offset.ndim)
        distance = xp.sqrt((offset**2).sum(-1, keepdims=True) + 1e-6)  # with a slope at 0, for the training
        return [distance / (2.0 * reach), xp.exp(-((distance / radius) ** 2))]

    positions, queues = seen["positions"], seen["queues"]
    offset = positions - seen["uav"][..., None, :2]
    nearby = [offset / (2.0 * reach_and_range(offset.ndim)[0]), *away(offset)]
    if "fills" in seen:
        nearby.append(0.5 * xp.log(100.0 * seen["fills"] + 0.01)[..., None])
    if "others" in seen:
        of_others = offset[..., None, :] - seen["others"][..., None, :, :]
        distance, near = away(of_others)
        own = xp.broadcast_to(seen["agent"][..., None, 1:], (*queues.shape, seen["agent"].shape[-1] - 1))
        nearby += [xp.min(distance, -2), xp.max(near, -2), own]  # without who they are, two UAVs in one place stay together
    return xp.concatenate([*nearby, 2.0 * queues[..., None] - 1.0, 2.0 * positions - 1.0], -1)


def scale_of(field: skysink.Field) -> NDArray[np.float64]:
    """The reach of one slot and the range of a link, in (longer) sides of the area."""
    return np.array([field.reach_m, field.comm_radius_m]) / max(field.area_m)


def choose(
    weights: Weights, observation: dict[str, NDArray[Any]], can_be_served: NDArray[np.bool_] | None = None
) -> NDArray[np.intp]:
    """The SN to fly towards, with the highest score, for one observation or a batch; of those that can be served, if any."""

    def dense(layer: int, value: NDArray[Any]) -> NDArray[Any]:
        return value @ weights[f"kernel_{layer}"] + weights[f"bias_{layer}"]

    each = np.tanh(dense(0, features(observation)))
    mean = np.tanh(dense(1, each)).mean(-2, keepdims=True)
    both = np.tanh(dense(2, np.concatenate([each, np.broadcast_to(mean, each.shape)], -1)))
    scores = dense(3, both)[..., 0]
    if can_be_served is not None:
        scores = np.where(can_be_served, scores, -np.inf)
    return np.asarray(scores.argmax(-1))


def load(path: Path = WEIGHTS) -> Weights:
    """Reads the weights written by rl_train.py."""
    with np.load(path, allow_pickle=False) as weights:
        return dict(weights)


class Learnt(skysink.Strategy):
    """A trained policy, deterministic; it serves the fullest queues in range."""

    path = WEIGHTS
    knows_rates = True

    def begin(self, field: skysink.Field) -> None:
        self.weights = load(self.path)
        self.positions_m = field.positions_m
        self.side_m = max(field.area_m)
        self.constant = {"positions": self.positions_m / self.side_m, "scale": scale_of(field)}

    def plan(self, view: skysink.View) -> skysink.Decision:
        field = view.field
        seen = self.constant | {
            "queues": view.queues_bits / field.capacities_bits,
            "uav": np.array([*(view.uav[:2] / self.side_m), 0.0]),
        }
        if self.knows_rates:
            seen["fills"] = view.sampling_bps * field.slot_s / field.capacities_bits
        target = choose(self.weights, seen, view.values > 0)
        return skysink.Decision(field.toward(view.uav, self.positions_m[target]))


class PPO(Learnt):
    """The policy that PPO trained for small.toml, where all rates are equal."""

    knows_rates = False


def main() -> None:
    standings = skysink.compare(SCENARIO, ["rfs", "gfs", "uts", "exact", PPO, "tour", "horizon"], seeds=20)
    print("strategy  loss rate  95 % interval")
    for row in standings:
        if row["metric"] == "loss_rate":
            lowest, highest = row["ci95"]
            print(f"{row['label']:<8} {row['mean']:10.4f}  {lowest:.4f} to {highest:.4f}")


if __name__ == "__main__":
    main()
